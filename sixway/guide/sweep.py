"""Light from coarse sweeps: optical depth towards all six lights on a grid that is aligned with the lights.

The lights stand along the axes of the camera, so along this grid's axes the way to a light is a running sum:
no march, no interpolation, and both lights of a pair from one sum.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.bands import RowBands
from sixway.core.frames import Camera, Grid
from sixway.guide import sweep_kernels, swept_march_kernels
from sixway.guide.config import GuideConfig
from sixway.guide.ray_kernels import Lanes
from sixway.guide.smoke import Smoke, box_average
from sixway.guide.smoke_kernels import Volume
from sixway.guide.views import to_light_in_world

_FLATTEST_AXES = 0.2
"""Least volume that the three axes may span; below it the grid would be stretched more than five times."""

_BLUR = 0.58
"""Edge in cells of the boxes that density is averaged over before cells sample it: box and interpolation then
spread a sample as far as an average over the cell would (w^2 / 12 + w^2 / 6 = 1 / 12)."""

WAYS = tuple(way for way in itertools.product((-1, 0, 1), repeat=3) if way > (0, 0, 0))
"""From a cell to its neighbours along a, b and c, one of each pair of opposite ways."""

SHARES = {1: 1.0 / 21.0, 2: 4.0 / 105.0, 3: 9.0 / 280.0}
"""Parts of the sphere that the ways stand for, by the axes they cross: exact to degree 7 (Lebedev 1976, 26 points)."""

_AHEAD = ((1.0, SHARES[1]), (0.5**0.5, 4.0 * SHARES[2]), (3.0**-0.5, 4.0 * SHARES[3]))
_RINGS = (*_AHEAD, (0.0, 4.0 * SHARES[1] + 4.0 * SHARES[2]), *((-cosine, share) for cosine, share in _AHEAD[::-1]))
"""Cosines between an axis and the ways, and the shares of the ways that form them."""


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
    def around(cls, boxes: Float[np.ndarray, "n 2 3"], camera: Camera, grid: Grid, config: GuideConfig) -> "LightGrid":
        """The grid of a view over boxes of smoke, given by their lower and upper corners [m].

        Cells stay where they are while smoke grows, so that a sequence does not flicker: their size follows from the
        volume, and one of their corners is the volume's centre.
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
        cell_m = max(grid.extent_m) / config.light_grid
        centre = 0.5 * np.array(grid.extent_m)
        centres = (boxes.mean(axis=1) - centre) @ to_axes.T
        halves = 0.5 * (boxes[:, 1] - boxes[:, 0]) @ np.abs(to_axes).T
        low = np.floor((centres - halves).min(axis=0) / cell_m + 1e-6).astype(int)
        high = np.ceil((centres + halves).max(axis=0) / cell_m - 1e-6).astype(int)
        a, b, c = np.maximum(high - low, 4)
        return cls(axes=axes, corner_m=centre + axes @ (low * cell_m), cell_m=cell_m, shape=(int(a), int(b), int(c)))

    def blur_voxels(self, voxel_m: float) -> int:
        """Edge of the boxes to average density over before the cells sample it."""
        return max(1, round(_BLUR * self.cell_m / voxel_m))


def lights_of(
    smoke: Smoke, camera: Camera, grid: Grid, config: GuideConfig, *, bands: RowBands
) -> swept_march_kernels.Lights:
    """The light grid of a view, filled."""
    volume = smoke.volume
    device = volume.density.device
    light_grid = LightGrid.around(smoke.boxes, camera, grid, config)
    extinction = volume.extinction_per_m * light_grid.cell_m
    cells, optical_depth = light_cells(volume, light_grid, extinction, bands=bands)
    scattered = wp.empty((0, 0, 0), dtype=Lanes, device=device)
    if config.scatter_iterations:
        scattered = scatter(
            *light_coarse_cells(cells, optical_depth, config.scatter_cells, bands=bands),
            extinction * config.scatter_cells,
            albedo=volume.albedo,
            hg_g=volume.hg_g,
            iterations=config.scatter_iterations,
            bands=bands,
        )
    lights = swept_march_kernels.Lights()
    lights.to_lights = wp.mat33(light_grid.axes.T)
    lights.to_cells = wp.mat33(np.linalg.inv(light_grid.axes * light_grid.cell_m))
    lights.corner_m = wp.vec3(*light_grid.corner_m)
    lights.optical_depth, lights.scattered, lights.scatter_cells = optical_depth, scattered, config.scatter_cells
    lights.samples = config.light_samples
    return lights


def light_cells(volume: Volume, lights: LightGrid, extinction: float, *, bands: RowBands) -> tuple[wp.array, wp.array]:
    """Density at every cell's centre, averaged over about a cell, and the optical depths from there to the lights.

    Both [c, b, a], the latter of `Lanes`. extinction: optical depth across a cell of density 1.
    """
    device = volume.density.device
    blur = lights.blur_voxels(volume.voxel_m)
    density = volume.density if blur == 1 else box_average(volume.density, blur, device=device, bands=bands)
    c, b, a = lights.shape[::-1]
    cells = wp.empty((c, b, a), dtype=float, device=device)
    optical_depth = wp.empty((c, b, a), dtype=Lanes, device=device)
    voxel_m = volume.voxel_m * blur
    bands.launch(
        sweep_kernels.fill_rows,
        dim=(c, b),
        inputs=[
            density,
            blur,
            volume.to_smoke,
            wp.vec3(*(lights.corner_m / voxel_m)),
            wp.mat33(lights.axes * (lights.cell_m / voxel_m)),
            extinction,
        ],
        outputs=[cells, optical_depth],
    )
    _sweep_across(cells, extinction, optical_depth, bands=bands)
    return cells, optical_depth


def _sweep_across(cells: wp.array, extinction: float, optical_depth: wp.array, *, bands: RowBands) -> None:
    c, b, a = cells.shape
    width = a if cells.device.is_cpu else 1
    for axis, planes in ((1, c), (2, b)):
        bands.launch(
            sweep_kernels.sweep_across,
            dim=(planes, -(-a // width)),
            inputs=[cells, extinction, axis, width],
            outputs=[optical_depth],
        )


def light_coarse_cells(
    cells: wp.array, optical_depth: wp.array, edge: int, *, bands: RowBands
) -> tuple[wp.array, wp.array]:
    """Mean density of blocks of edge^3 cells, and what arrives at their smoke from each light, weighted by density.

    A block may be thick: light at its centre would say little about what its smoke receives.
    """
    shape = tuple(-(-n // edge) for n in cells.shape)
    density = wp.empty(shape, dtype=float, device=cells.device)
    direct = wp.empty(shape, dtype=Lanes, device=cells.device)
    bands.launch(
        sweep_kernels.light_coarse_cells,
        dim=shape,
        inputs=[cells, optical_depth, edge],
        outputs=[density, direct],
    )
    return density, direct


def scatter(
    density: wp.array,
    direct: wp.array,
    extinction: float,
    *,
    albedo: float,
    hg_g: float,
    iterations: int,
    bands: RowBands,
) -> wp.array:
    """Light that has scattered up to `iterations` times, as even fluence that would send as much to the camera.

    In parts of the irradiance, [c, b, a]. extinction: optical depth across a cell of density 1. Discrete ordinates
    along the lines from a cell through its 26 neighbours, where sweeps need no interpolation; with the six of the axes
    alone, thick smoke stops at 41 dB of a reference. The first scattering and the one to the camera follow the phase
    function, `turned`; those between count as isotropic.
    """
    scattered = wp.zeros_like(direct)
    for iteration in range(iterations):
        gathered = wp.zeros_like(direct)
        for way in WAYS:
            length = float(np.linalg.norm(way))
            share = SHARES[np.abs(way).sum()]
            # the first of a pair of lights shines down its axis; the camera stands at the upper end of the last axis
            parts = [share * turned(cosine, hg_g) for axis in way for cosine in (-axis / length, axis / length)]
            along, against = Lanes(*parts, 0.0, 0.0), Lanes(*(parts[n ^ 1] for n in range(6)), 0.0, 0.0)
            seen = (1.0, 1.0)
            if iteration == iterations - 1:
                seen = (turned(way[2] / length, hg_g), turned(-way[2] / length, hg_g))
            bands.launch(
                sweep_kernels.scatter_along,
                dim=density.shape,
                inputs=[
                    density,
                    extinction * length,
                    wp.vec3i(*way),
                    albedo,
                    share,
                    along,
                    against,
                    wp.vec2(*seen),
                    direct,
                    scattered,
                ],
                outputs=[gathered],
            )
        scattered = gathered
    return scattered


def turned(cosine: float, hg_g: float) -> float:
    """Light that scatters into one of the 26 ways, as a multiple of what even scattering would send there.

    cosine: between the light's travel and the way, one of the seven that a way and an axis can form. The sphere is cut
    into rings around the light, one for each cosine and as large as its ways' shares, and the phase function (Henyey
    and Greenstein 1941) is integrated over them.
    """
    cosines, rings = zip(*_RINGS, strict=True)
    ring = int(np.argmin(np.abs(np.array(cosines) - cosine)))
    first = 1.0 - 2.0 * sum(rings[:ring])
    if abs(hg_g) < 1e-3:
        return 1.0

    def below(cosine: float) -> float:
        root = (1.0 + hg_g * hg_g - 2.0 * hg_g * cosine) ** 0.5
        return (1.0 - hg_g * hg_g) / (2.0 * hg_g) * (1.0 / root - 1.0 / (1.0 + hg_g))

    return (below(first) - below(max(first - 2.0 * rings[ring], -1.0))) / rings[ring]
