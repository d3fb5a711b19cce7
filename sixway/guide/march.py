"""The guiding map: light in smoke from a few sides, cheaply (Algorithm 1, Eq. 6, or coarse sweeps)."""

from collections.abc import Iterator, Sequence

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.bands import RowBands
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, GuideMap, Medium
from sixway.guide import march_kernels, smoke_kernels, swept_march_kernels
from sixway.guide.config import GuideConfig
from sixway.guide.ray_kernels import Lanes
from sixway.guide.smoke import Smoke, upload
from sixway.guide.sweep import lights_of
from sixway.guide.views import normalised_depth, to_light_in_world, view_of

Pictures = tuple[
    Float[np.ndarray, "h w l"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]
]
"""In-scatter of the config's lights (M = pi L / E), transmittance, metres to the first smoke, and emitted light."""


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

    def march_views(
        self, frame: DensityFrame, cameras: Sequence[Camera], *, seeds: Sequence[int]
    ) -> Iterator[GuideMap]:
        """The guides of several cameras that see the same frame, one after the other, each as `march` says.

        They share the frame on the device, its mip and its map of empty air. The light grid is each view's own: it
        stands along the camera's axes, and the sums to top and bottom, which level cameras have in common in the
        world, are a hundredth of a view's cost.
        Raises ValueError unless there is one seed a camera, and as `march` does.
        """
        if len(cameras) != len(seeds):
            raise ValueError(f"{len(cameras)} cameras and {len(seeds)} seeds: give each camera one seed")
        return (self.march(frame, camera, seed=seed) for camera, seed in zip(cameras, seeds, strict=True))

    def march(self, frame: DensityFrame, camera: Camera, *, seed: int) -> GuideMap:
        """The guide of one frame seen by one camera; equal arguments give equal bytes.

        Raises ValueError where `vertical` is undefined for the view.
        """
        config = self.config
        if frame is not self._frame:  # once for all the cameras that look at it
            self._smoke = upload(
                frame, self.medium, mip=config.mip, emission=config.emission, device=self._device, bands=self._bands
            )
            self._frame = frame
        lit, transmittance, depth_m, emissive = (
            self._nothing(camera) if self._smoke is None else self._pictures(self._smoke, frame.grid, camera, seed)
        )
        if config.sum_lights:
            lit = lit.sum(axis=-1, keepdims=True)
        depth = normalised_depth(depth_m, camera, frame.grid)
        layers = [lit, transmittance[..., None], depth[..., None]]
        if config.emission:
            layers.append(emissive[..., None])
        image = np.concatenate(layers, axis=-1, dtype=np.float32)
        return GuideMap(channels=config.channels, image=image, depth_m=depth_m)

    def _pictures(self, smoke: Smoke, grid: Grid, camera: Camera, seed: int) -> Pictures:
        config = self.config
        if config.lighting == "sweep":
            kernel = swept_march_kernels.march_swept
            lighting: list[object] = [lights_of(smoke, camera, grid, config, bands=self._bands)]
            lights = [DIRECTIONS.index(name) for name in config.light_names]
        else:
            kernel = march_kernels.march_guide
            to_light = [to_light_in_world(name, camera, config.vertical) for name in config.light_names]
            lighting = [
                wp.vec3(grid.extent_m),
                wp.vec3(*smoke.low),
                wp.vec3(*smoke.high),
                wp.array(np.array(to_light, dtype=np.float32), dtype=wp.vec3, device=self._device),
                int(config.weight == "paper_literal"),
            ]
            lights = list(range(len(to_light)))
        size = (camera.height_px, camera.width_px)
        lit, transmittance, depth_m, emissive = (
            wp.empty(size, dtype=Lanes, device=self._device),
            wp.empty(size, dtype=float, device=self._device),
            wp.empty(size, dtype=float, device=self._device),
            wp.empty(size if config.emission else (0, 0), dtype=float, device=self._device),
        )
        view, scalars = view_of(camera, grid), [config.step_m(grid), int(config.jitter), wp.uint32(seed & 0xFFFFFFFF)]

        def launch(rays_a_side: int, chosen: wp.array) -> None:
            self._bands.launch(
                kernel,
                dim=size,
                inputs=[view, smoke.volume, *scalars, rays_a_side, chosen, *lighting],
                outputs=[lit, transmittance, depth_m, emissive],
            )

        launch(1, wp.empty((0, 0), dtype=wp.int8, device=self._device))
        if config.pixel_samples > 1:
            edges = wp.empty(size, dtype=wp.int8, device=self._device)
            self._bands.launch(smoke_kernels.find_edges, dim=size, inputs=[transmittance], outputs=[edges])
            launch(config.rays_a_side(camera, grid), edges)
        return lit.numpy()[..., lights], transmittance.numpy(), depth_m.numpy(), emissive.numpy()

    def _nothing(self, camera: Camera) -> Pictures:
        size = (camera.height_px, camera.width_px)
        for name in self.config.light_names:  # an undefined view is an error without smoke as well
            to_light_in_world(name, camera, self.config.vertical)
        dark = np.zeros((*size, len(self.config.light_names)), np.float32)
        return dark, np.ones(size, np.float32), np.full(size, np.inf, np.float32), np.zeros(size, np.float32)
