"""Six renders with Mitsuba's own volumetric path tracer: slow, unbiased, the audit of the cached method."""

from collections.abc import Iterator, Sequence
from typing import Any

import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, Bounces
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.reference.media import Extinction, padded
from sixway.reference.scene import SmokeScene, scene_key
from sixway.reference.unlit import march_unlit

_MAX_DEPTH: dict[Bounces, int] = {"single": 2, "paper": 3, "multi": -1}  # Mitsuba counts the path's edges
_PATHS_PER_PASS = 1 << 23
_ROULETTE_DEPTH = 64  # its default of 5 would cost more noise than it saves time


class StockTracer:
    """Reusable over frames, cameras and seeds; a new grid, image size or kind of camera loads a new scene.

    Noise falls with 1 / sqrt(samples), samples being paths per pixel and light. No obstacles.
    """

    def __init__(self, *, bounces: Bounces, samples: int, medium: Medium, light_angle_deg: float = 0.0) -> None:
        medium.grey_albedo  # noqa: B018  # raises for colours
        self.medium = medium
        self.samples = samples
        self._light_angle_deg = light_angle_deg
        self._integrator = volpath(bounces)
        self._scene: SmokeScene | None = None

    def trace_views(
        self, frame: DensityFrame, cameras: Sequence[Camera], *, seeds: Sequence[int]
    ) -> Iterator[Float[np.ndarray, "h w c"]]:
        """Each camera's picture on its own: renders share nothing."""
        for camera, seed in zip(cameras, seeds, strict=True):
            yield self.trace(frame, camera, seed=seed)

    def trace(self, frame: DensityFrame, camera: Camera, *, seed: int) -> Float[np.ndarray, "h w c"]:
        """M = pi L / E of the six lights, alpha, and emissive if the frame has emission; float32.

        Raises ValueError for solid obstacles and for a camera inside the volume.
        """
        if frame.obstacle is not None and (frame.obstacle > 0.5).any():
            raise ValueError(
                "method 'stock' cannot hide smoke behind obstacles; use method 'cached' or 'path', which need LLVM "
                "or CUDA, or a frame without obstacle"
            )
        extinction = padded(frame, self.medium)
        check_outside(extinction, camera)
        if self._scene is None or self._scene.key != scene_key(extinction.grid, camera):
            self._scene = SmokeScene(extinction.grid, camera, self.medium, light_angle_deg=self._light_angle_deg)
        self._scene.show(extinction, camera)
        channels = []
        for number, direction in enumerate(DIRECTIONS):
            self._scene.light_from(direction, camera)
            # each light its own random numbers: shared ones would correlate the noise of the maps
            light = render(self._scene.scene, self._integrator, camera, samples=self.samples, seeds=(seed, number))
            channels.append(np.pi * light)
        unlit = march_unlit(extinction, camera)
        channels.extend(np.moveaxis(unlit if frame.emission is not None else unlit[..., :1], -1, 0))
        return np.stack(channels, axis=-1).astype(np.float32)


def volpath(bounces: Bounces) -> Any:
    """Mitsuba's integrator; lights are not seen directly, only what they light."""
    return mi.load_dict(
        {"type": "volpath", "max_depth": _MAX_DEPTH[bounces], "rr_depth": _ROULETTE_DEPTH, "hide_emitters": True}
    )


def render(
    scene: Any, integrator: Any, camera: Camera, *, samples: int, seeds: tuple[int, int]
) -> Float[np.ndarray, "h w"]:
    """Radiance, in as many passes as memory asks for."""
    per_pass = max(1, _PATHS_PER_PASS // (camera.width_px * camera.height_px))
    passes = [min(per_pass, samples - done) for done in range(0, samples, per_pass)]
    pass_seeds = np.random.SeedSequence(seeds).generate_state(len(passes))
    total = np.zeros((camera.height_px, camera.width_px))
    for count, pass_seed in zip(passes, pass_seeds, strict=True):
        image = mi.render(scene, integrator=integrator, spp=count, seed=int(pass_seed))
        total += count * np.array(image)[..., 0]
    return np.maximum(total / samples, 0.0)  # volpath's differences leave values like -1e-9


def check_outside(extinction: Extinction, camera: Camera) -> None:
    """Raise ValueError for a pinhole inside the box of smoke."""
    grid = extinction.grid
    offset = np.abs(np.array(camera.position_m) - grid.centre_m) / (0.5 * np.array(grid.extent_m))
    if camera.kind == "perspective" and offset.max() < 1.0:
        raise ValueError(
            f"the camera at {camera.position_m} m stands inside the volume, where method 'stock' sees nothing; "
            "move it back or use method 'cached'"
        )
