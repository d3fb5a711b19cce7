"""How fine a scenario is computed: the tiers, and the lattice steps that a frame takes."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from sixway.core.config import Config
from sixway.core.frames import Grid, Vector
from sixway.sim.units import LatticeUnits

Tier = Literal["tiny", "small", "medium", "paper"]


class ResolutionConfig(Config):
    """Cells of the velocity grid along the longest edge of the box, and smoke voxels along each cell."""

    cells: int = Field(ge=8, le=512)
    refinement: Literal[1, 2, 4]


TIERS: dict[Tier, ResolutionConfig] = {
    "tiny": ResolutionConfig(cells=32, refinement=2),
    "small": ResolutionConfig(cells=64, refinement=2),
    "medium": ResolutionConfig(cells=100, refinement=2),
    "paper": ResolutionConfig(cells=100, refinement=4),
}
"""Velocity and smoke voxels along the longest edge: 32/64, 64/128, 100/200, 100/400."""

Resolution = Annotated[Tier | ResolutionConfig, Field(union_mode="left_to_right")]


def grids(resolution: Tier | ResolutionConfig, box_m: Vector) -> tuple[Grid, Grid]:
    """Grids of velocity and smoke, centred on the origin. The longest edge is kept, others go to whole cells."""
    chosen = TIERS[resolution] if isinstance(resolution, str) else resolution
    longest_m = max(box_m)
    cells = [max(1, round(chosen.cells * edge / longest_m)) for edge in box_m]
    x, y, z = cells
    r = chosen.refinement
    return (
        Grid.centred((z, y, x), longest_edge_m=longest_m),
        Grid.centred((z * r, y * r, x * r), longest_edge_m=longest_m),
    )


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Lattice steps of a frame, cut into moves of the smoke of `steps_per_advection` lattice steps each."""

    units: LatticeUnits
    steps_per_frame: int
    steps_per_advection: int

    @classmethod
    def fit(
        cls, *, dx_m: float, frame_s: float, speed_m_s: float, lattice_speed: float, reach_cells: float
    ) -> "Timing":
        """The fewest steps in which `speed_m_s` is at most `lattice_speed` [cells/step].

        reach_cells: how far smoke of that speed may go in one move; finer moves blur more, longer ones
        leave gaps behind a source that is one cell thick.
        """
        steps = frame_s * speed_m_s / (lattice_speed * dx_m)
        moves = max(1, math.ceil(steps * lattice_speed / reach_cells - 1e-9))
        steps_per_advection = max(1, math.ceil(steps / moves - 1e-9))
        steps_per_frame = moves * steps_per_advection
        return cls(
            units=LatticeUnits(dx_m=dx_m, dt_s=frame_s / steps_per_frame),
            steps_per_frame=steps_per_frame,
            steps_per_advection=steps_per_advection,
        )
