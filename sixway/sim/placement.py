"""Where a scenario's sources stand on its grids."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from sixway.core.frames import Grid
from sixway.sim.gusts import Gusts
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.sources import InletConfig, WindConfig


@dataclass(frozen=True, kw_only=True)
class ImposedCells:
    """The cells whose velocity is imposed, one row each; lattice units.

    cell: (x, y, z) counting the shell. source: its inlet or wind, numbered through. mean: velocity without gusts
    [cells/step]. gusts: of each source.
    """

    cell: Int[np.ndarray, "n 3"]
    source: Int[np.ndarray, "n"]
    mean: Float[np.ndarray, "n 3"]
    gusts: tuple[Gusts, ...]


def imposed_cells(scenario: ScenarioConfig) -> ImposedCells:
    """Cells of discs, a layer of one to three in the box, and of winds, the shell of their side. Discs go first."""
    grid, units = scenario.velocity_grid, scenario.units
    points = voxel_centres(grid, shell=1)
    owner = np.full(points.shape[:3], -1)
    for number, source in enumerate(scenario.blowing):
        owner[_covered(source, points, grid)] = number
    z, y, x = np.nonzero(owner >= 0)
    of_cell = owner[z, y, x]
    mean, gusts = np.zeros((len(of_cell), 3)), []
    for number, source in enumerate(scenario.blowing):
        mine = of_cell == number
        mean[mine] = units.velocity_to_lattice(1.0) * _mean_velocity(source, points[z, y, x][mine], grid)
        size_m = source.radius_m if isinstance(source, InletConfig) else 0.25 * min(grid.extent_m)
        gusts.append(
            Gusts.draw(
                np.random.default_rng([scenario.seed, number]),
                radius=size_m / units.dx_m,
                speed=units.velocity_to_lattice(source.speed_m_s),
                turbulence=source.turbulence,
            )
        )
    return ImposedCells(cell=np.stack([x, y, z], axis=1), source=of_cell, mean=mean, gusts=tuple(gusts))


def first_wind(scenario: ScenarioConfig) -> Float[np.ndarray, "z y x 3"]:
    """Velocity of the air when the simulation starts [cells/step]: the sum of the winds, rest without any."""
    grid = scenario.velocity_grid
    points = voxel_centres(grid)
    wind = sum((_mean_velocity(wind, points, grid) for wind in scenario.winds), start=np.zeros(points.shape))
    return (scenario.units.velocity_to_lattice(1.0) * wind).astype(np.float32)


class SmokeSources:
    """What inlets and puffs keep up on the smoke grid, which changes when a puff comes or goes."""

    def __init__(self, scenario: ScenarioConfig) -> None:
        self._names = scenario.scalar_names
        grid, cell_m = scenario.density_grid, scenario.velocity_grid.voxel_size_m
        self._shape = grid.shape_zyx
        self._inlets = [
            (inlet, _covered_voxels(grid, partial(inlet.covers, half_thickness_m=cell_m))) for inlet in scenario.inlets
        ]
        self._puffs = [
            (puff, _covered_voxels(grid, partial(puff.covers, seed=(scenario.seed, 1000 + number))))
            for number, puff in enumerate(scenario.puffs)
        ]

    def active(self, *, since_s: float, until_s: float) -> tuple[int, ...]:
        """Numbers of the puffs that are kept up at some moment of [since, until)."""
        return tuple(
            number
            for number, (puff, _) in enumerate(self._puffs)
            if puff.start_s < until_s and puff.start_s + puff.duration_s >= since_s
        )

    def fields(self, puffs: tuple[int, ...]) -> dict[str, Float[np.ndarray, "z y x"]]:
        """What the inlets and those puffs keep up, float32 by name, 0 elsewhere; fields without any are left out."""
        sources = [*self._inlets, *(self._puffs[number] for number in puffs)]
        fields = {name: np.zeros(self._shape, np.float32) for name in self._names}
        for source, covered in sources:
            for name, field in fields.items():
                amount = {"density": source.density, "temperature": source.temperature_k, "fuel": source.fuel}.get(
                    name, 0.0
                )
                field[covered] = np.maximum(field[covered], amount)
        return {name: field for name, field in fields.items() if field.any()}


def voxel_centres(grid: Grid, *, shell: int = 0) -> Float[np.ndarray, "z y x 3"]:
    """World positions (x, y, z) [m] of every voxel's centre, float64, with so many more voxels on every side."""
    z, y, x = (np.arange(-shell, n + shell) + 0.5 for n in grid.shape_zyx)
    ijk = np.stack(np.broadcast_arrays(x[None, None, :], y[None, :, None], z[:, None, None]), axis=-1)
    return np.array(grid.origin_m) + ijk * grid.voxel_size_m


def _covered_voxels(grid: Grid, covers: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Which voxels a source covers, [z, y, x], layer by layer: centres of 400^3 voxels would fill gigabytes."""
    z, y, x = grid.shape_zyx
    east, up, south = grid.origin_m
    layers = (replace(grid, shape_zyx=(1, y, x), origin_m=(east, up, south + k * grid.voxel_size_m)) for k in range(z))
    return np.concatenate([covers(voxel_centres(layer)) for layer in layers])


def _covered(source: InletConfig | WindConfig, points: np.ndarray, grid: Grid) -> np.ndarray:
    inside = np.zeros(points.shape[:3], bool)
    if isinstance(source, InletConfig):
        # one cell to either side leaves no hole in a tilted disc, and one layer on a wall
        inside[1:-1, 1:-1, 1:-1] = True
        return inside & source.covers(points, half_thickness_m=grid.voxel_size_m)
    axis = "zyx".index(source.face[0])
    index: list[int | slice] = [slice(1, -1)] * 3
    index[axis] = 0 if source.face.endswith("low") else -1
    inside[tuple(index)] = True
    return inside


def _mean_velocity(source: InletConfig | WindConfig, points: np.ndarray, grid: Grid) -> np.ndarray:
    if isinstance(source, InletConfig):
        return source.mean_velocity(points)
    return source.mean_velocity(points, floor_m=grid.origin_m[1], height_m=grid.extent_m[1])
