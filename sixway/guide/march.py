"""The guiding map: light in smoke from a few sides, cheaply (Algorithm 1, Eq. 6, or coarse sweeps)."""

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.bands import RowBands
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, GuideMap, Medium
from sixway.guide import kernels
from sixway.guide.config import GuideConfig
from sixway.guide.smoke import Smoke, upload
from sixway.guide.sweep import sweep_lit
from sixway.guide.views import camera_arguments, normalised_depth, to_light_in_world

Pictures = tuple[Float[np.ndarray, "h w l"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]
"""In-scatter of the config's lights (M = pi L / E), transmittance, and metres to the first smoke."""


class GuideMarcher:
    """Marches guides for frame after frame; one instance a medium, config and device.

    threads: CPU threads.
    """

    def __init__(self, config: GuideConfig, medium: Medium, *, device: str, threads: int = 1) -> None:
        self.config = config
        self.medium = medium
        self._device = wp.get_device(device)
        self._bands = RowBands(self._device, threads=threads)
        self._frame: DensityFrame | None = None
        self._smoke: Smoke | None = None

    def march(self, frame: DensityFrame, camera: Camera, *, seed: int) -> GuideMap:
        """The guide of one frame seen by one camera; equal arguments give equal bytes.

        Raises ValueError where `vertical` is undefined for the view.
        """
        if frame is not self._frame:  # once for all the cameras that look at it
            self._smoke = upload(frame, self.medium, mip=self.config.mip, device=self._device, bands=self._bands)
            self._frame = frame
        if self._smoke is None:
            lit, transmittance, depth_m = self._nothing(camera)
        elif self.config.lighting == "sweep":
            lights = [DIRECTIONS.index(name) for name in self.config.light_names]
            six, transmittance, depth_m = sweep_lit(
                self._smoke, camera, frame.grid, self.medium, self.config, seed=seed, bands=self._bands
            )
            lit = six[..., lights]
        else:
            lit, transmittance, depth_m = self._march_lit(self._smoke, frame, camera, seed)
        if self.config.sum_lights:
            lit = lit.sum(axis=-1, keepdims=True)
        depth = normalised_depth(depth_m, camera, frame.grid)
        image = np.concatenate([lit, transmittance[..., None], depth[..., None]], axis=-1)
        return GuideMap(channels=self.config.channels, image=image.astype(np.float32), depth_m=depth_m)

    def _march_lit(self, smoke: Smoke, frame: DensityFrame, camera: Camera, seed: int) -> Pictures:
        config, grid = self.config, frame.grid
        to_light = [to_light_in_world(name, camera, config.vertical) for name in config.light_names]
        size = (camera.height_px, camera.width_px)
        outputs = (
            wp.empty((*size, len(to_light)), dtype=float, device=self._device),
            wp.empty(size, dtype=float, device=self._device),
            wp.empty(size, dtype=float, device=self._device),
        )
        self._bands.launch(
            kernels.march_guide,
            dim=size,
            inputs=[
                smoke.density,
                smoke.voxel_m,
                smoke.obstacle,
                smoke.obstacle_voxel_m,
                wp.vec3(grid.extent_m),
                *(wp.vec3(*corner) for corner in (smoke.low, smoke.high, smoke.seen_low, smoke.seen_high)),
                *camera_arguments(camera, grid),
                wp.array(np.array(to_light, dtype=np.float32), dtype=wp.vec3, device=self._device),
                self.medium.extinction_per_m,
                self.medium.albedo,
                self.medium.hg_g,
                config.step_m(grid),
                smoke.depth_threshold,
                int(config.weight == "paper_literal"),
                int(config.jitter),
                wp.uint32(seed & 0xFFFFFFFF),
            ],
            outputs=outputs,
        )
        in_scatter, transmittance, depth_m = outputs
        return in_scatter.numpy(), transmittance.numpy(), depth_m.numpy()

    def _nothing(self, camera: Camera) -> Pictures:
        size = (camera.height_px, camera.width_px)
        for name in self.config.light_names:  # an undefined view is an error without smoke as well
            to_light_in_world(name, camera, self.config.vertical)
        dark = np.zeros((*size, len(self.config.light_names)), np.float32)
        return dark, np.ones(size, np.float32), np.full(size, np.inf, np.float32)
