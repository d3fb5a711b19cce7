"""The guiding map: a large-step march that lights smoke from a few sides (Algorithm 1, Eq. 6)."""

from concurrent.futures import ThreadPoolExecutor
from typing import Literal, Self

import numpy as np
import warp as wp
from jaxtyping import Float
from pydantic import Field, model_validator

from sixway.core.config import Config
from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.core.frames import Camera, Grid, Vector
from sixway.core.records import DensityFrame, GuideMap, Medium
from sixway.guide import kernels

Direction = Literal["right", "left", "top", "bottom", "front", "back"]

_DEPTH_THRESHOLD = 1e-3
"""Smoke begins where density exceeds this part of the frame's maximum (the paper's tau)."""

_BAND_ROWS = 8
"""Rows that a thread takes at a time; smoke sits in the middle, so few large bands would be uneven."""

_SMALLEST_DEPTH = 1e-3
"""Depth 0 means empty, so the nearest smoke keeps a value above it."""


class GuideConfig(Config):
    """What the guide holds and how coarsely it is marched; the defaults are the paper's guide."""

    lights: tuple[Direction, ...] = Field(default=("front", "top", "bottom"), min_length=1)
    """Surrogate lights."""
    sum_lights: bool = True
    """One ``in_scatter`` channel for all lights (the paper), or one channel a light, by its name."""
    steps_per_edge: int = Field(default=40, ge=4, le=1024)
    """The step h is the longest box edge over this, so that the guide does not change with the grid."""
    step_voxels: float | None = Field(default=None, gt=0.0)
    """Step in voxels instead, as the paper counts (10 of a 400^3 grid)."""
    jitter: bool = True
    """Shift each ray's samples by a seeded part of a step, against banding."""
    vertical: Literal["camera_up", "world_up", "omega_cross_z"] = "camera_up"
    """What top and bottom mean; `omega_cross_z` is the printed form, undefined for a view along z."""
    weight: Literal["exact", "paper_literal"] = "exact"
    """A_n = T_{n-1} (1 - exp(-sigma h)), or the printed T_{n-1} sigma, which lacks the step length."""

    @model_validator(mode="after")
    def _lights_once(self) -> Self:
        if len(set(self.lights)) != len(self.lights):
            raise ValueError(f"lights {self.lights} names a light twice; list each once")
        return self

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the guide, in order."""
        lit = ("in_scatter",) if self.sum_lights else tuple(d for d in DIRECTIONS if d in self.lights)
        return (*lit, "transmittance", "depth")

    def step_m(self, grid: Grid) -> float:
        """The step length h [m] in that grid."""
        if self.step_voxels is not None:
            return self.step_voxels * grid.voxel_size_m
        return max(grid.extent_m) / self.steps_per_edge


class GuideMarcher:
    """Marches guides for frame after frame; one instance a medium, config and device.

    threads: CPU threads; Warp runs a CPU kernel on one thread, but lets go of Python's lock meanwhile.
    """

    def __init__(self, config: GuideConfig, medium: Medium, *, device: str, threads: int = 1) -> None:
        self.config = config
        self.medium = medium
        self._device = wp.get_device(device)
        self._threads = threads
        self._frame: DensityFrame | None = None

    def march(self, frame: DensityFrame, camera: Camera, *, seed: int) -> GuideMap:
        """The guide of one frame seen by one camera; equal arguments give equal bytes.

        Raises ValueError where `vertical` is undefined for the view.
        """
        self._upload(frame)
        config, grid = self.config, frame.grid
        lights = [d for d in DIRECTIONS if d in config.lights]
        to_light = [to_light_in_world(name, camera, config.vertical) for name in lights]
        size = (camera.height_px, camera.width_px)
        arguments = [
            self._density,
            self._obstacle,
            int(frame.obstacle is not None),
            grid.voxel_size_m,
            wp.vec3(grid.extent_m),
            *camera_arguments(camera, grid),
            wp.array(np.array(to_light, dtype=np.float32), dtype=wp.vec3, device=self._device),
            self.medium.extinction_per_m,
            self.medium.albedo,
            self.medium.hg_g,
            config.step_m(grid),
            _DEPTH_THRESHOLD * float(frame.density.max()),
            int(config.weight == "paper_literal"),
            int(config.jitter),
            wp.uint32(seed & 0xFFFFFFFF),
        ]
        in_scatter = wp.empty((*size, len(lights)), dtype=float, device=self._device)
        transmittance = wp.empty(size, dtype=float, device=self._device)
        depth_m = wp.empty(size, dtype=float, device=self._device)

        def march_rows(first: int, count: int) -> None:
            wp.launch(
                kernels.march_guide,
                dim=(count, size[1]),
                inputs=[first, *arguments],
                outputs=[in_scatter, transmittance, depth_m],
                device=self._device,
            )

        if self._device.is_cpu and self._threads > 1:
            wp.load_module(kernels, device=self._device)  # before threads: loading is not safe from several
            bands = [(row, min(_BAND_ROWS, size[0] - row)) for row in range(0, size[0], _BAND_ROWS)]
            with ThreadPoolExecutor(self._threads) as pool:
                list(pool.map(lambda band: march_rows(*band), bands))
        else:
            march_rows(0, size[0])
        lit = in_scatter.numpy()
        if config.sum_lights:
            lit = lit.sum(axis=-1, keepdims=True)
        metric = depth_m.numpy()
        depth = normalised_depth(metric, camera, grid)
        image = np.concatenate([lit, transmittance.numpy()[..., None], depth[..., None]], axis=-1)
        return GuideMap(channels=config.channels, image=image.astype(np.float32), depth_m=metric)

    def _upload(self, frame: DensityFrame) -> None:
        """Copy the volume to the device, once for all the cameras that look at it."""
        if frame is self._frame:
            return
        obstacle = frame.obstacle if frame.obstacle is not None else np.zeros((1, 1, 1), np.float32)
        self._density = wp.array(frame.density, dtype=float, device=self._device)
        self._obstacle = wp.array(obstacle, dtype=float, device=self._device)
        self._frame = frame


def to_light_in_world(name: str, camera: Camera, vertical: str) -> Vector:
    """World unit vector towards a surrogate light, under the chosen reading of top and bottom.

    Raises ValueError for `omega_cross_z` where the camera looks along the world's z axis.
    """
    if name not in ("top", "bottom") or vertical == "camera_up":
        return camera.to_world(TO_LIGHT[name])
    if vertical == "world_up":
        axis = np.array([0.0, 1.0, 0.0])
    else:
        axis = np.cross(camera.to_viewer, (0.0, 0.0, 1.0))
        length = float(np.linalg.norm(axis))
        if length < 1e-4:
            raise ValueError(
                "guide.vertical omega_cross_z is undefined for a camera that looks along the world's z axis; "
                "use camera_up or another yaw"
            )
        axis = axis / length
    x, y, z = axis if name == "top" else -axis
    return (float(x), float(y), float(z))


def camera_arguments(camera: Camera, grid: Grid) -> list[object]:
    """The camera as the kernels take it: metres relative to the grid's corner."""
    position = np.array(camera.position_m) - np.array(grid.origin_m)
    right, up, to_viewer = camera.basis
    return [
        wp.vec3(*position),
        wp.vec3(*(-camera.distance_m * to_viewer)),
        wp.vec3(*(camera.half_width_m * right)),
        wp.vec3(*(camera.half_height_m * up)),
        int(camera.kind == "perspective"),
    ]


def normalised_depth(depth_m: Float[np.ndarray, "h w"], camera: Camera, grid: Grid) -> Float[np.ndarray, "h w"]:
    """Metric depth to (0, 1] between the near and far end of the bounding sphere; 0 where empty."""
    offset = np.array(grid.centre_m) - np.array(camera.position_m)
    near = abs(float(offset @ np.array(camera.to_viewer))) - grid.radius_m
    if camera.kind == "perspective":
        near = float(np.linalg.norm(offset)) - grid.radius_m
    scaled = np.clip((depth_m - near) / (2.0 * grid.radius_m), _SMALLEST_DEPTH, 1.0)
    return np.where(np.isfinite(depth_m), scaled, 0.0).astype(np.float32)
