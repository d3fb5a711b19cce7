"""Which places of sources and bodies a scenario's grids cannot carry."""

import numpy as np

from sixway.core.frames import Grid
from sixway.sim.bodies.shapes import Body, check_bodies, nearest_approach
from sixway.sim.sources import InletConfig, PuffConfig
from sixway.sim.units import LatticeUnits


def check_places(
    *,
    inlets: tuple[InletConfig, ...],
    puffs: tuple[PuffConfig, ...],
    bodies: tuple[Body, ...],
    grid: Grid,
    units: LatticeUnits,
    duration_s: float,
    frame_s: float,
) -> None:
    """Raise ValueError, naming the value, the rule and the remedy, for what the grids cannot carry.

    Sources inside the box and blowing into it, at least 1.5 cells in radius, two cells away from every body as long
    as it moves; bodies as `shapes.check_bodies` asks. grid: of the velocity. Bodies are looked at once a frame.
    """
    cell_m = grid.voxel_size_m
    half = 0.5 * np.array(grid.extent_m)
    times = [float(time) for time in np.arange(0.0, duration_s + 0.5 * frame_s, frame_s)]
    check_bodies(bodies, grid=grid, units=units, times_s=times)
    for number, inlet in enumerate(inlets):
        name = f"inlets.{number}"
        _check_radius(name, inlet.radius_m, cell_m)
        _check_inside(name, inlet.centre_m, half + 1e-6 * cell_m)  # a tilted disc on a wall may cut into it
        if np.any(np.abs(np.array(inlet.centre_m) + 2.0 * cell_m * inlet.axis) > half):
            raise ValueError(
                f"{name}: blows from centre_m={inlet.centre_m} along {inlet.towards} out of the box; turn `towards` "
                "round or move the inlet away from the wall"
            )
        gap, when = nearest_approach(bodies, inlet.rim(), times_s=times, within_m=2.0 * cell_m)
        if gap < 2.0 * cell_m:
            raise ValueError(
                f"{name}: an obstacle covers it or comes as near as {gap:.3g} m at {when:.3g} s; leave two velocity "
                f"cells ({2.0 * cell_m:.3g} m) between them: move or shrink the obstacle"
            )
    for number, puff in enumerate(puffs):
        _check_radius(f"puffs.{number}", puff.radius_m, cell_m)
        _check_inside(f"puffs.{number}", puff.centre_m, half)
        if puff.start_s > duration_s:
            raise ValueError(
                f"puffs.{number}: starts at {puff.start_s} s, after the last frame at {duration_s:.4g} s; "
                "start it earlier or raise frames"
            )


def _check_radius(name: str, radius_m: float, cell_m: float) -> None:
    if radius_m < 1.5 * cell_m:
        raise ValueError(
            f"{name}: radius_m={radius_m} is below 1.5 velocity cells of {cell_m:.4g} m; make it at least "
            f"{1.5 * cell_m:.4g} or choose a finer resolution"
        )


def _check_inside(name: str, centre_m: tuple[float, float, float], half: np.ndarray) -> None:
    if np.any(np.abs(centre_m) > half):
        raise ValueError(
            f"{name}: centre_m={centre_m} lies outside the box, which reaches "
            f"({', '.join(f'{value:g}' for value in half)}) m to either side of the origin; move it in"
        )
