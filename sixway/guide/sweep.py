"""Light from coarse sweeps: optical depth towards all six lights on a grid that is aligned with the lights.

The lights stand along the axes of the camera, so along this grid's axes the way to a light is a running sum:
no march, no interpolation, and both lights of a pair from one sum.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.bands import RowBands
from sixway.core.frames import Camera, Grid
from sixway.core.records import Medium
from sixway.guide import sweep_kernels
from sixway.guide.config import GuideConfig
from sixway.guide.smoke import Smoke, box_average
from sixway.guide.views import camera_arguments, to_light_in_world

_FLATTEST_AXES = 0.2
"""Least volume that the three axes may span; below it the grid would be stretched more than five times."""

_BLUR = 0.58
"""Edge in cells of the boxes that density is averaged over before cells sample it: box and interpolation then
spread a sample as far as an average over the cell would (w^2 / 12 + w^2 / 6 = 1 / 12)."""


@dataclass(frozen=True)
class LightGrid:
    """Cubic cells over the smoke along the axes to right, top and front.

    axes: columns are these world unit vectors; they need not be orthogonal where `vertical` is not the camera's.
    corner_m: of the cell (0, 0, 0), from the grid's corner. cell_m: edge. shape: cells along the axes, at least 4.
    """

    axes: np.ndarray
    corner_m: np.ndarray
    cell_m: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, boxes: Float[np.ndarray, "n 2 3"], camera: Camera, config: GuideConfig) -> "LightGrid":
        """The grid of a view over boxes of smoke, given by their lower and upper corners [m].

        Raises ValueError where the vertical leaves the three axes nearly in one plane.
        """
        names = ("right", "top", "front")
        axes = np.array([to_light_in_world(name, camera, config.vertical) for name in names]).T
        if abs(np.linalg.det(axes)) < _FLATTEST_AXES:
            raise ValueError(
                f"guide.vertical {config.vertical} puts top, right and front nearly in one plane for this camera, "
                "which lighting sweep cannot take; use lighting march, vertical camera_up or another view"
            )
        to_axes = np.linalg.inv(axes)
        centres, halves = boxes.mean(axis=1) @ to_axes.T, 0.5 * (boxes[:, 1] - boxes[:, 0]) @ np.abs(to_axes).T
        low, high = (centres - halves).min(axis=0), (centres + halves).max(axis=0)
        cell_m = float((high - low).max()) / config.light_grid
        a, b, c = np.maximum(np.ceil((high - low) / cell_m - 1e-6).astype(int), 4)
        start = 0.5 * (low + high - cell_m * np.array([a, b, c]))
        return cls(axes=axes, corner_m=axes @ start, cell_m=cell_m, shape=(int(a), int(b), int(c)))

    def blur_voxels(self, voxel_m: float) -> int:
        """Edge of the boxes to average density over before the cells sample it."""
        return max(1, round(_BLUR * self.cell_m / voxel_m))


def sweep_lit(
    smoke: Smoke, camera: Camera, grid: Grid, medium: Medium, config: GuideConfig, *, seed: int, bands: RowBands
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """In-scatter of all six lights [h, w, 6], transmittance and depth_m [h, w] of one view."""
    device = smoke.density.device
    lights = LightGrid.around(smoke.boxes, camera, config)
    cells = resample_density(smoke, lights, bands=bands)
    optical_depth = sweep_optical_depth(cells, medium.extinction_per_m * lights.cell_m, bands=bands)
    scattered = wp.empty((0, 0, 0), dtype=sweep_kernels.SixLights, device=device)
    if config.scatter_iterations:
        scattered = scatter(
            box_average(cells, 2, device=device, bands=bands),
            medium.extinction_per_m * lights.cell_m * 2.0,
            albedo=medium.albedo,
            iterations=config.scatter_iterations,
            bands=bands,
        )
    size = (camera.height_px, camera.width_px)
    outputs = (
        wp.empty(size, dtype=sweep_kernels.SixLights, device=device),
        wp.empty(size, dtype=float, device=device),
        wp.empty(size, dtype=float, device=device),
    )
    bands.launch(
        sweep_kernels.march_swept,
        dim=size,
        inputs=[
            smoke.density,
            smoke.voxel_m,
            smoke.obstacle,
            smoke.obstacle_voxel_m,
            smoke.holds,
            wp.vec3(*smoke.seen_low),
            wp.vec3(*smoke.seen_high),
            *camera_arguments(camera, grid),
            wp.mat33(lights.axes.T),
            medium.extinction_per_m,
            medium.albedo,
            medium.hg_g,
            config.step_m(grid),
            config.light_samples,
            smoke.depth_threshold,
            int(config.jitter),
            wp.uint32(seed & 0xFFFFFFFF),
            optical_depth,
            scattered,
            wp.vec3(*lights.corner_m),
            wp.mat33(np.linalg.inv(lights.axes * lights.cell_m)),
        ],
        outputs=outputs,
    )
    in_scatter, transmittance, depth_m = outputs
    return in_scatter.numpy(), transmittance.numpy(), depth_m.numpy()


def resample_density(smoke: Smoke, lights: LightGrid, *, bands: RowBands) -> wp.array:
    """Density at each cell's centre, [c, b, a], averaged over about a cell."""
    device = smoke.density.device
    blur = lights.blur_voxels(smoke.voxel_m)
    density = smoke.density if blur == 1 else box_average(smoke.density, blur, device=device, bands=bands)
    shape = lights.shape[::-1]
    cells = wp.empty(shape, dtype=float, device=device)
    bands.launch(
        sweep_kernels.resample_density,
        dim=shape,
        inputs=[density, smoke.voxel_m * blur, wp.vec3(*lights.corner_m), wp.mat33(lights.axes * lights.cell_m)],
        outputs=[cells],
    )
    return cells


def sweep_optical_depth(cells: wp.array, extinction: float, *, bands: RowBands) -> wp.array:
    """Optical depth from each cell's centre to each light, [c, b, a] of `SixLights`.

    extinction: optical depth across a cell of density 1.
    """
    optical_depth = wp.empty(cells.shape, dtype=sweep_kernels.SixLights, device=cells.device)
    for axis, columns in _columns(cells):
        inputs = [cells, extinction, axis]
        bands.launch(sweep_kernels.sweep_lights, dim=columns, inputs=inputs, outputs=[optical_depth])
    return optical_depth


def scatter(cells: wp.array, extinction: float, *, albedo: float, iterations: int, bands: RowBands) -> wp.array:
    """Fluence of light that has scattered up to `iterations` times, in parts of the irradiance, [c, b, a].

    Discrete ordinates along the six ways of the grid's axes, where sweeps need no interpolation; every scattering
    counts as isotropic. Scattered light is smooth: cells twice as large as those of the lights lose 0.1 dB.
    """
    optical_depth = sweep_optical_depth(cells, extinction, bands=bands)
    direct = wp.empty_like(optical_depth)
    bands.launch(sweep_kernels.light_cells, dim=cells.shape, inputs=[optical_depth], outputs=[direct])
    scattered = wp.zeros_like(direct)
    for _ in range(iterations):
        gathered = wp.zeros_like(direct)
        for axis, columns in _columns(cells):
            inputs = [cells, extinction, axis, albedo / 6.0, direct, scattered]
            bands.launch(sweep_kernels.scatter_along, dim=columns, inputs=inputs, outputs=[gathered])
        scattered = gathered
    return scattered


def _columns(cells: wp.array) -> list[tuple[int, tuple[int, ...]]]:
    """Each axis with the numbers of cells along the other two."""
    return [(axis, tuple(n for place, n in enumerate(cells.shape) if place != 2 - axis)) for axis in range(3)]
