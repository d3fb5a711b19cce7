"""A simulation at a glance: six of its frames side by side, lit from the right and the front."""

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.guide.config import LIGHT_SETS, GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.shading.compose import over, shade
from sixway.shading.light import DirectionalLight
from sixway.volumes.extinction import extinction_for_optical_depth

_LIGHTS = (
    DirectionalLight(to_light=(0.8, 0.6, 0.0), colour=(2.2, 2.0, 1.7)),
    DirectionalLight(to_light=(-0.6, 0.0, 0.8), colour=(0.35, 0.45, 0.6)),
)
_SKY = np.array([0.05, 0.08, 0.13], np.float32)
_SOLID = np.array([0.16, 0.15, 0.14], np.float32)


def filmstrip(frames: list[DensityFrame], *, height_px: int = 256, device: str = "cpu") -> Float[np.ndarray, "h w 3"]:
    """Linear RGB of the frames side by side, seen from the front; obstacles are flat silhouettes behind the smoke.

    The densest frame is given an optical depth of 8. frames: at least one, of one grid.
    """
    grid = frames[0].grid
    densest = max(frames, key=lambda frame: float(frame.density.sum()))
    width, height, _ = grid.extent_m
    camera = Camera.orthographic(
        position_m=(grid.centre_m[0], grid.centre_m[1], grid.centre_m[2] + 2.0 * grid.radius_m),
        target_m=grid.centre_m,
        size_m=min(width, height),
        width_px=round(height_px * width / height),
        height_px=height_px,
    )
    medium = Medium(extinction_per_m=extinction_for_optical_depth(densest) if densest.density.any() else 1.0)
    config = GuideConfig(
        lights=LIGHT_SETS["all"], sum_lights=False, lighting="sweep", scatter_iterations=1, emission=True
    )
    marcher = GuideMarcher(config, medium, device=device)
    return np.concatenate([_picture(marcher, frame, camera) for frame in frames], axis=1)


def _picture(marcher: GuideMarcher, frame: DensityFrame, camera: Camera) -> Float[np.ndarray, "h w 3"]:
    guide = marcher.march(frame, camera, seed=0)
    alpha = 1.0 - guide["transmittance"]
    maps = [guide[name] for name in DIRECTIONS]
    lightmap = SixWayLightmap(
        channels=(*DIRECTIONS, "alpha", "emissive"), image=np.stack([*maps, alpha, guide["emissive"]], axis=-1)
    )
    return over(shade(lightmap, _LIGHTS), alpha, _behind(frame, camera))


def _behind(frame: DensityFrame, camera: Camera) -> Float[np.ndarray, "h w 3"]:
    """Sky, and the silhouettes of obstacles: the camera looks along z and sees exactly the box."""
    if frame.obstacle is None:
        return np.broadcast_to(_SKY, (camera.height_px, camera.width_px, 3))
    silhouette = frame.obstacle.max(axis=0)[::-1]
    y = (np.arange(camera.height_px) * silhouette.shape[0] // camera.height_px)[:, None]
    x = (np.arange(camera.width_px) * silhouette.shape[1] // camera.width_px)[None, :]
    part = silhouette[y, x][..., None]
    return (1.0 - part) * _SKY + part * _SOLID
