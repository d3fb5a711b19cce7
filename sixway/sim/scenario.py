"""What to simulate: the box, what blows into it, what stands in it, and for how long."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sixway.core.config import Config
from sixway.core.frames import Grid
from sixway.sim.inlets import InletConfig
from sixway.sim.obstacles import Obstacle, distance_to_all
from sixway.sim.units import LatticeUnits

Cells = Annotated[int, Field(ge=8, le=512)]


class ScenarioConfig(Config):
    """One simulation. World axes: x right, y up, z towards the viewer; the box is centred on the origin,
    closed at its floor and sides and open at its top."""

    name: str = Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_.-]+$")
    """Names files; letters, digits and _ . - only."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seeds the gusts: another seed, another plume."""

    cells_xyz: tuple[Cells, Cells, Cells] = (32, 32, 32)
    """Cells of the velocity grid along x, y, z."""
    density_refinement: int = Field(default=2, ge=1, le=4)
    """Density voxels along the edge of a velocity cell."""
    longest_edge_m: float = Field(default=1.0, gt=0.0, le=1000.0)
    """Longest edge of the box [m]."""

    frames: int = Field(default=24, ge=1, le=10_000)
    """Frames to hand over."""
    warmup_frames: int = Field(default=0, ge=0, le=10_000)
    """Frames that pass before the first one that is handed over."""
    steps_per_frame: int = Field(default=16, ge=1, le=1000)
    """Lattice steps between two frames."""
    steps_per_advection: int = Field(default=4, ge=1, le=64)
    """Lattice steps between two moves of the smoke; fewer blur more."""
    lattice_speed: float = Field(default=0.1, gt=0.0, le=0.15)
    """Mean speed of the fastest inlet [cells/step]; sets the time step."""

    viscosity_m2_s: float = Field(default=1.5e-5, ge=0.0, le=10.0)
    """Kinematic viscosity [m^2/s]; air by default, which leaves most of the work to `smagorinsky`."""
    smagorinsky: float = Field(default=0.1, ge=0.0, le=0.3)
    """Smagorinsky's constant C_s, unitless; below 0.1 thin air tends to blow up."""
    buoyancy_m_s2: float = Field(default=0.0, ge=0.0, le=1000.0)
    """Upward acceleration [m/s^2] of smoke of density 1."""
    advection: Literal["cubic", "linear"] = "cubic"
    """How smoke is read between voxels: clamped Catmull-Rom (sharp) or trilinear (fast, blurs)."""

    inlets: tuple[InletConfig, ...] = Field(min_length=1, max_length=16)
    obstacles: tuple[Obstacle, ...] = Field(default=(), max_length=64)

    @property
    def velocity_grid(self) -> Grid:
        x, y, z = self.cells_xyz
        return Grid.centred((z, y, x), longest_edge_m=self.longest_edge_m)

    @property
    def density_grid(self) -> Grid:
        x, y, z = (n * self.density_refinement for n in self.cells_xyz)
        return Grid.centred((z, y, x), longest_edge_m=self.longest_edge_m)

    @property
    def units(self) -> LatticeUnits:
        return LatticeUnits.from_speed(
            dx_m=self.velocity_grid.voxel_size_m,
            speed_m_s=max(inlet.speed_m_s for inlet in self.inlets),
            lattice_speed=self.lattice_speed,
        )

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        if self.steps_per_frame % self.steps_per_advection:
            raise ValueError(
                f"steps_per_frame={self.steps_per_frame} is no multiple of steps_per_advection="
                f"{self.steps_per_advection}; smoke must arrive at every frame: change one of them"
            )
        return self

    @model_validator(mode="after")
    def _smoke_leaves_no_gaps(self) -> Self:
        reach = self.lattice_speed * self.steps_per_advection
        if reach > 1.0:  # a disc on a wall is one cell thick
            raise ValueError(
                f"steps_per_advection={self.steps_per_advection} skips {reach:.2g} cells at lattice_speed="
                f"{self.lattice_speed}; smoke would leave its inlet in puffs above 1 cell: lower either"
            )
        return self

    @model_validator(mode="after")
    def _speeds_stay_subsonic(self) -> Self:
        to_lattice = self.units.velocity_to_lattice
        peak = max(to_lattice(i.speed_m_s * (1.0 + abs(i.swirl) + 3.0 * i.turbulence)) for i in self.inlets)
        if peak > 0.35:
            raise ValueError(
                f"an inlet peaks at {peak:.2f} cells/step with its swirl and gusts; at most 0.35 is stable: "
                f"lower lattice_speed={self.lattice_speed} to {self.lattice_speed * 0.35 / peak:.3f}"
            )
        height = self.velocity_grid.extent_m[1]
        fall = np.sqrt(2.0 * self.buoyancy_m_s2 * max(i.density for i in self.inlets) * height)
        fall = to_lattice(float(fall))
        if fall > 0.4:
            raise ValueError(
                f"buoyancy_m_s2={self.buoyancy_m_s2} could lift smoke to {fall:.2f} cells/step; at most 0.4 is "
                f"stable: lower it to {self.buoyancy_m_s2 * (0.4 / fall) ** 2:.3g} or lower lattice_speed"
            )
        return self

    @model_validator(mode="after")
    def _obstacles_fit(self) -> Self:
        cell_m = self.velocity_grid.voxel_size_m
        half = 0.5 * np.array(self.velocity_grid.extent_m)
        for number, obstacle in enumerate(self.obstacles):
            if obstacle.radius_m < 1.5 * cell_m:
                raise ValueError(
                    f"obstacles.{number}: radius_m={obstacle.radius_m} is below 1.5 velocity cells of "
                    f"{cell_m:.4g} m; make it at least {1.5 * cell_m:.4g} or raise cells_xyz"
                )
            if np.any(np.abs(obstacle.centre_m) > half):
                raise ValueError(
                    f"obstacles.{number}: centre_m={obstacle.centre_m} lies outside the box, which reaches "
                    f"{_text(half)} m to either side of the origin; move it in"
                )
        return self

    @model_validator(mode="after")
    def _inlets_fit(self) -> Self:
        cell_m = self.velocity_grid.voxel_size_m
        half = 0.5 * np.array(self.velocity_grid.extent_m)
        for number, inlet in enumerate(self.inlets):
            if inlet.radius_m < 1.5 * cell_m:
                raise ValueError(
                    f"inlets.{number}: radius_m={inlet.radius_m} is below 1.5 velocity cells of "
                    f"{cell_m:.4g} m; make it at least {1.5 * cell_m:.4g} or raise cells_xyz"
                )
            if np.any(np.abs(inlet.centre_m) > half + 1e-6 * cell_m):  # a tilted disc on a wall may cut into it
                raise ValueError(
                    f"inlets.{number}: centre_m={inlet.centre_m} lies outside the box, which reaches "
                    f"{_text(half)} m to either side of the origin; move it in"
                )
            if np.any(np.abs(np.array(inlet.centre_m) + 2.0 * cell_m * inlet.axis) > half):
                raise ValueError(
                    f"inlets.{number}: blows from centre_m={inlet.centre_m} along {inlet.towards} out of the "
                    "box; turn `towards` round or move the inlet away from the wall"
                )
            gap = float(distance_to_all(self.obstacles, inlet.rim()).min())
            if gap < 2.0 * cell_m:
                raise ValueError(
                    f"inlets.{number}: an obstacle covers it or comes as near as {gap:.3g} m; leave two velocity "
                    f"cells ({2.0 * cell_m:.3g} m) between them: move or shrink the obstacle"
                )
        return self


def _text(half_m: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:g}" for value in half_m) + ")"
