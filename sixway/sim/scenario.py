"""What to simulate: the box, what blows into it, what stands and moves in it, and for how long."""

import math
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, field_validator, model_validator

from sixway.core.config import Config
from sixway.core.frames import Grid
from sixway.core.store import sha256_file
from sixway.sim.bodies.shapes import MeshBody, ObstacleConfig
from sixway.sim.carried.burn import NEEDED, BurnConfig
from sixway.sim.carried.scalars import FaceKind, Scheme
from sixway.sim.checks import check_places
from sixway.sim.flow.faces import SIDES, Faces, Side, opposite
from sixway.sim.flow.flow import FlowConfig
from sixway.sim.resolution import Resolution, Timing, grids
from sixway.sim.sources import InletConfig, PuffConfig, WindConfig
from sixway.sim.units import LatticeUnits

Edge = Annotated[float, Field(gt=0.0, le=1000.0)]

_REACH_CELLS = 1.0
"""How far the fastest source may carry smoke in one move: a disc on a wall is one cell thick."""
_MOST_VOXELS = (2**31 - 1) // 4
"""Fields are float32 planes [field, z, y, x], and Warp keeps the bytes between two of them in 32 bits."""
_FASTEST_LATTICE_SPEED = 0.4
"""[cells/step]; lattice Boltzmann holds for speeds well below that of sound, 0.577."""


class AirConfig(FlowConfig):
    """The air of a scenario: open on all sides above a floor, unless `faces` says otherwise (then for all sides)."""

    faces: Faces = Faces(x_low="open", x_high="open", y_high="open", z_low="open", z_high="open")


class SmokeConfig(Config):
    """How smoke, heat and fuel are carried and how they push the air."""

    scheme: Scheme = "cubic"
    """Semi-Lagrangian: clamped Catmull-Rom (sharp), or trilinear (fast, blurs)."""
    buoyancy_m_s2: float = Field(default=0.0, ge=-1000.0, le=1000.0)
    """Upward acceleration [m/s^2] of smoke of density 1; below 0 it sinks."""
    heat_buoyancy_m_s2_k: float = Field(default=9.81 / 293.0, ge=0.0, le=10.0)
    """Upward acceleration [m/s^2] of gas 1 K hotter than the air; Boussinesq: g over the air's temperature."""
    vorticity_confinement: float = Field(default=0.0, ge=0.0, le=50.0)
    """Strength of Fedkiw, Stam & Jensen 2001, unitless: the same on every grid; 0 adds none."""
    dissipation_per_s: float = Field(default=0.0, ge=0.0, le=1000.0)
    """Share of the smoke that fades in a second (exponential rate)."""
    cooling_per_s: float = Field(default=0.0, ge=0.0, le=1000.0)
    """Rate at which temperature falls towards that of the air, exponential."""
    radiation_k_per_s: float = Field(default=0.0, ge=0.0, le=100_000.0)
    """How fast gas that is `burn.hottest_k` hot (1,000 K without fire) cools by radiation, with its fourth power."""

    @field_validator("scheme", mode="before")
    @classmethod
    def _is_offered(cls, scheme: object) -> object:
        if scheme == "maccormack":
            raise ValueError(
                "'maccormack' was removed, since cubic keeps more at half its cost; use cubic (sharp) or linear (fast)"
            )
        return scheme


class ScenarioConfig(Config):
    """One simulation. World axes: x right, y up, z towards the viewer; the box is centred on the origin."""

    name: str = Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_.-]+$")
    """Names files; letters, digits and _ . - only."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seeds gusts and puffs: another seed, another plume."""

    box_m: tuple[Edge, Edge, Edge] = (1.0, 1.0, 1.0)
    """Edges of the box along x, y, z [m]; the shorter ones are rounded to whole cells."""
    resolution: Resolution = "tiny"
    """`tiny` (32 cells along the longest edge, 64 smoke voxels), `small` (64, 128), `medium` (100, 200), `paper`
    (100, 400), or {cells, refinement}."""

    frames: int = Field(default=24, ge=1, le=10_000)
    """Frames to hand over."""
    warmup_frames: int = Field(default=0, ge=0, le=10_000)
    """Frames that pass before the first one that is handed over."""
    frames_per_second: float = Field(default=20.0, gt=0.0, le=1000.0)
    """Of simulated time."""
    speed_m_s: float | None = Field(default=None, gt=0.0, le=1000.0)
    """Speed [m/s] that moves at `lattice_speed`; without it, that of the fastest inlet or wind."""
    lattice_speed: float = Field(default=0.1, gt=0.0, le=0.2)
    """[cells/step]; sets the time step. Lower is slower and less compressible."""

    viscosity_m2_s: float = Field(default=1.5e-5, ge=0.0, le=10.0)
    """Kinematic viscosity [m^2/s]; air by default, which leaves most of the work to the flow's model."""
    flow: AirConfig = AirConfig()
    smoke: SmokeConfig = SmokeConfig()
    burn: BurnConfig | None = None
    """How fuel burns; without it there is no fire."""

    inlets: tuple[InletConfig, ...] = Field(default=(), max_length=16)
    winds: tuple[WindConfig, ...] = Field(default=(), max_length=5)
    puffs: tuple[PuffConfig, ...] = Field(default=(), max_length=64)
    obstacles: tuple[ObstacleConfig, ...] = Field(default=(), max_length=64)

    @property
    def velocity_grid(self) -> Grid:
        return grids(self.resolution, self.box_m)[0]

    @property
    def density_grid(self) -> Grid:
        return grids(self.resolution, self.box_m)[1]

    @property
    def refinement(self) -> int:
        """Smoke voxels along the edge of a velocity cell."""
        return self.density_grid.shape_zyx[2] // self.velocity_grid.shape_zyx[2]

    @property
    def frame_s(self) -> float:
        return 1.0 / self.frames_per_second

    @property
    def duration_s(self) -> float:
        """From the start to the last frame [s]."""
        return (self.warmup_frames + self.frames) * self.frame_s

    @property
    def timing(self) -> Timing:
        return Timing.fit(
            dx_m=self.velocity_grid.voxel_size_m,
            frame_s=self.frame_s,
            speed_m_s=self._speed_m_s(),
            lattice_speed=self.lattice_speed,
            reach_cells=_REACH_CELLS,
        )

    @property
    def units(self) -> LatticeUnits:
        return self.timing.units

    @property
    def blowing(self) -> tuple[WindConfig | InletConfig, ...]:
        """All that imposes a velocity; inlets go before winds where both are."""
        return self.winds + self.inlets

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """Fields that are carried: what nothing feeds or asks for is left out."""
        if self.burn is not None:
            return NEEDED
        hot = any(source.temperature_k > 0.0 for source in (*self.inlets, *self.puffs))
        return ("density", "temperature") if hot else ("density",)

    @property
    def scalar_faces(self) -> dict[Side, FaceKind]:
        """What the faces are to smoke: through open ones and winds clear air comes in."""
        blown = {wind.face for wind in self.winds}
        kinds: dict[Side, FaceKind] = {}
        for side in SIDES:
            face = getattr(self.flow.faces, side)
            is_open = face == "open" or side in blown
            kinds[side] = "periodic" if face == "periodic" else "open" if is_open else "closed"
        return kinds

    def identity(self) -> dict[str, Any]:
        """As `Config` says, of all that shapes a frame: a mesh by its bytes instead of its path, and not how many
        frames there are, because more of them change none."""
        values = super().identity()
        del values["frames"]
        for body, held in zip(self.obstacles, values["obstacles"], strict=True):
            if isinstance(body, MeshBody):
                held["path"] = sha256_file(Path(body.path))
        return values

    def _speed_m_s(self) -> float:
        if self.speed_m_s is not None:
            return self.speed_m_s
        return max(source.speed_m_s for source in self.blowing)

    @model_validator(mode="after")
    def _arrays_fit(self) -> Self:
        voxels = math.prod(self.density_grid.shape_zyx)
        if voxels > _MOST_VOXELS:
            z, y, x = self.density_grid.shape_zyx
            raise ValueError(
                f"resolution: {x} x {y} x {z} smoke voxels are {voxels:,}; at most {_MOST_VOXELS:,} (812^3) fit the "
                f"32-bit strides of Warp's arrays: lower cells or refinement"
            )
        return self

    @model_validator(mode="after")
    def _something_happens(self) -> Self:
        if not self.inlets and not self.puffs:
            raise ValueError("no smoke: there are neither inlets nor puffs; add one of them")
        if self.speed_m_s is None and not self.inlets and not self.winds:
            raise ValueError("nothing says how fast it is: set speed_m_s, near the highest speed of the scene")
        return self

    @model_validator(mode="after")
    def _fuel_burns(self) -> Self:
        fed = any(source.fuel > 0.0 for source in (*self.inlets, *self.puffs))
        if fed and self.burn is None:
            raise ValueError("a source feeds fuel that nothing burns; add a section `burn` or set fuel to 0")
        if self.burn is not None and self.flow.encoding == "moments":
            raise ValueError("fire makes gas, which flow.encoding='moments' cannot take in; use populations")
        if self.burn is not None and not fed:
            raise ValueError(
                "there is a section `burn` but no source of fuel; give an inlet or a puff some, or drop it"
            )
        return self

    @model_validator(mode="after")
    def _speeds_stay_subsonic(self) -> Self:
        to_lattice = self.units.velocity_to_lattice
        peak = max((to_lattice(source.peak_m_s) for source in self.blowing), default=0.0)
        if peak > 0.35:
            raise ValueError(
                f"a source peaks at {peak:.2f} cells/step with its swirl and gusts; at most 0.35 is stable: "
                f"lower lattice_speed={self.lattice_speed} to {self.lattice_speed * 0.35 / peak:.3f}"
            )
        sources = (*self.inlets, *self.puffs)
        burning_k = self.burn.hottest_k if self.burn else 0.0
        weight, lift = abs(self.smoke.buoyancy_m_s2), self.smoke.heat_buoyancy_m_s2_k
        push = max(weight * s.density + lift * max(s.temperature_k, burning_k * (s.fuel > 0.0)) for s in sources)
        rise = to_lattice(math.sqrt(2.0 * push * self.velocity_grid.extent_m[1]))
        if rise > _FASTEST_LATTICE_SPEED:
            raise ValueError(
                f"buoyancy (of hot gas too) could drive smoke to {rise:.2f} cells/step; at most "
                f"{_FASTEST_LATTICE_SPEED} is stable: lower it by a factor "
                f"{(rise / _FASTEST_LATTICE_SPEED) ** 2:.2g}, lower lattice_speed, or set "
                f"speed_m_s={self._speed_m_s() * rise / _FASTEST_LATTICE_SPEED:.3g}"
            )
        return self

    @model_validator(mode="after")
    def _air_finds_a_way_out(self) -> Self:
        if self.blowing and "open" not in {getattr(self.flow.faces, side) for side in SIDES}:
            raise ValueError("air blows in and has no way out; make a side of flow.faces open, such as y_high: open")
        return self

    @model_validator(mode="after")
    def _winds_blow_out(self) -> Self:
        for number, wind in enumerate(self.winds):
            out = opposite(wind.face)
            if getattr(self.flow.faces, out) != "open":
                raise ValueError(
                    f"winds.{number}: what blows in through {wind.face} has no way out: make {out} open in flow.faces"
                )
            if getattr(self.flow.faces, wind.face) == "periodic":
                raise ValueError(f"winds.{number}: {wind.face} is periodic; make it a wall, which the wind replaces")
        return self

    @model_validator(mode="after")
    def _everything_fits(self) -> Self:
        check_places(
            inlets=self.inlets,
            puffs=self.puffs,
            bodies=self.obstacles,
            grid=self.velocity_grid,
            units=self.units,
            duration_s=self.duration_s,
            frame_s=self.frame_s,
        )
        return self
