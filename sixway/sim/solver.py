"""The simulation: owns the buffers and the order in which kernels run."""

from collections.abc import Iterator

import numpy as np
import warp as wp

from sixway.core.records import DensityFrame
from sixway.sim import kernels
from sixway.sim.inlets import Gusts
from sixway.sim.lattice import FLUID, INLET, OPEN, SOLID, SOUND_SPEED, relaxation_time
from sixway.sim.obstacles import distance_to_all, solid_fraction, voxel_centres
from sixway.sim.scenario import ScenarioConfig

INSIDE = (slice(1, -1),) * 3
"""The box within the shell of SOLID and OPEN cells that closes the periodic lattice."""


class SmokeSolver:
    """Simulates one scenario on one device; the same scenario and device give the same bytes.

    >>> for frame in SmokeSolver(scenario, device="cpu").frames():  # doctest: +SKIP
    ...     save(frame)
    """

    def __init__(self, scenario: ScenarioConfig, *, device: str) -> None:
        self.scenario = scenario
        self.lattice_steps = 0
        self._device = wp.get_device(device)
        self._units = scenario.units
        self._tau = relaxation_time(self._units.viscosity_to_lattice(scenario.viscosity_m2_s))
        self._lift_strength = self._units.acceleration_to_lattice(scenario.buoyancy_m_s2)
        self._obstacle_fraction = solid_fraction(scenario.obstacles, scenario.density_grid)

        kind = cell_kinds(scenario)
        self._shape = kind.shape
        self._kind = self._put(kind, wp.int32)
        self._lift = self._zeros(kind.shape, wp.float32)
        self._velocity = self._zeros(kind.shape, wp.vec3)
        self._populations = self._zeros((19, *kind.shape), wp.float32)
        self._populations_next = wp.zeros_like(self._populations)
        self._make_inlets()

        self._obstacle = self._put(self._obstacle_fraction, wp.float32)
        self._source = self._put(smoke_source(scenario), wp.float32)
        self._smoke = wp.zeros_like(self._source)
        self._smoke_next = wp.zeros_like(self._source)

    def frames(self) -> Iterator[DensityFrame]:
        """Warm up, then yield `scenario.frames` frames. Raises RuntimeError if the flow blows up."""
        for _ in range(self.scenario.warmup_frames):
            self.advance()
        for _ in range(self.scenario.frames):
            self.advance()
            yield self.frame()

    def advance(self) -> None:
        """Run to the next frame. Raises RuntimeError, naming the remedy, if the flow blew up."""
        for _ in range(self.scenario.steps_per_frame // self.scenario.steps_per_advection):
            self.step()
        self._check_stable()

    def step(self) -> None:
        """Move the air by `steps_per_advection` lattice steps and then the smoke with it."""
        self._lift_smoke()
        for _ in range(self.scenario.steps_per_advection):
            self._blow_inlets()
            self._collide_and_stream()
        self._advect_smoke()

    def frame(self) -> DensityFrame:
        """The smoke now; `time_s` counts from the moment when the inlets opened."""
        velocity = np.ascontiguousarray(self._velocity.numpy()[INSIDE])
        return DensityFrame(
            density=self._smoke.numpy().copy(),
            grid=self.scenario.density_grid,
            time_s=self.lattice_steps * self._units.dt_s,
            velocity_m_s=velocity * np.float32(self._units.velocity_m_s),
            obstacle=self._obstacle_fraction,
        )

    def _lift_smoke(self) -> None:
        if self._lift_strength == 0.0:
            return
        inputs = [self._smoke, self.scenario.density_refinement, self._lift_strength, self._lift]
        self._launch(kernels.buoyancy, self.scenario.velocity_grid.shape_zyx, inputs)

    def _blow_inlets(self) -> None:
        inputs = [*self._inlet_arrays, float(self.lattice_steps), self._velocity]
        self._launch(kernels.blow, (len(self._inlet_arrays[0]),), inputs)

    def _collide_and_stream(self) -> None:
        before, after = self._populations, self._populations_next
        inputs = [self._kind, self._lift, self._tau, self.scenario.smagorinsky, before, after, self._velocity]
        self._launch(kernels.collide_and_stream, self._shape, inputs)
        self._populations, self._populations_next = after, before
        self.lattice_steps += 1

    def _advect_smoke(self) -> None:
        before, after = self._smoke, self._smoke_next
        refinement, steps = float(self.scenario.density_refinement), float(self.scenario.steps_per_advection)
        cubic = self.scenario.advection == "cubic"
        inputs = [self._velocity, self._source, self._obstacle, refinement, steps, cubic, before, after]
        self._launch(kernels.advect, before.shape, inputs)
        self._smoke, self._smoke_next = after, before

    def _check_stable(self) -> None:
        fastest = float(np.abs(self._velocity.numpy()).max())  # the one wait for the device in a frame
        if not fastest < SOUND_SPEED:  # also true of NaN
            raise RuntimeError(
                f"scenario {self.scenario.name!r} blew up by lattice step {self.lattice_steps}: the air moves at "
                f"{fastest:.3g} cells/step and must stay below {SOUND_SPEED:.3g}; lower lattice_speed="
                f"{self.scenario.lattice_speed}, raise smagorinsky={self.scenario.smagorinsky} (0.1 is safe) or "
                f"raise viscosity_m2_s={self.scenario.viscosity_m2_s}"
            )

    def _make_inlets(self) -> None:
        """Arrays of `kernels.blow`: one row per INLET cell, one row of gusts per inlet."""
        scenario, units = self.scenario, self._units
        owner = inlet_of_cell(scenario)
        z, y, x = np.nonzero(owner >= 0)
        number = owner[z, y, x]
        points = voxel_centres(scenario.velocity_grid)[z, y, x]
        mean = np.zeros((len(number), 3))
        gusts = []
        for n, inlet in enumerate(scenario.inlets):
            mean[number == n] = units.velocity_to_lattice(1.0) * inlet.mean_velocity(points[number == n])
            rng = np.random.default_rng([scenario.seed, n])
            speed = units.velocity_to_lattice(inlet.speed_m_s)
            radius = inlet.radius_m / units.dx_m
            gusts.append(Gusts.draw(rng, radius=radius, speed=speed, turbulence=inlet.turbulence))
        self._inlet_arrays = [
            self._put(np.stack([x, y, z], axis=1) + 1, wp.vec3i),
            self._put(number, wp.int32),
            self._put(mean, wp.vec3),
            self._put(np.stack([g.wave for g in gusts]), wp.vec3),
            self._put(np.stack([g.amplitude for g in gusts]), wp.vec3),
            self._put(np.stack([g.frequency for g in gusts]), wp.float32),
            self._put(np.stack([g.phase for g in gusts]), wp.float32),
        ]

    def _put(self, values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(values, dtype=dtype, device=self._device)

    def _zeros(self, shape: tuple[int, ...], dtype: type) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self._device)

    def _launch(self, kernel: wp.Kernel, dim: tuple[int, ...], inputs: list) -> None:
        wp.launch(kernel, dim=dim, inputs=inputs, device=self._device)


def inlet_of_cell(scenario: ScenarioConfig) -> np.ndarray:
    """Number of the inlet that each velocity cell belongs to, -1 for none, [z, y, x]."""
    grid = scenario.velocity_grid
    centres = voxel_centres(grid)
    owner = np.full(grid.shape_zyx, -1)
    for number, inlet in enumerate(scenario.inlets):
        # one cell to either side leaves no hole in a tilted disc, and one layer on a wall
        owner[inlet.covers(centres, half_thickness_m=grid.voxel_size_m)] = number
    return owner


def cell_kinds(scenario: ScenarioConfig) -> np.ndarray:
    """Kind of each cell, [z + 2, y + 2, x + 2] int32: the box in a shell, SOLID but for the OPEN top."""
    grid = scenario.velocity_grid
    box = np.where(inlet_of_cell(scenario) >= 0, INLET, FLUID)
    box[distance_to_all(scenario.obstacles, voxel_centres(grid)) < 0.0] = SOLID
    kind = np.full([n + 2 for n in grid.shape_zyx], SOLID, dtype=np.int32)
    kind[1:-1, -1, 1:-1] = OPEN
    kind[INSIDE] = box
    return kind


def smoke_source(scenario: ScenarioConfig) -> np.ndarray:
    """Density that the inlets keep up, [z, y, x] float32 on the density grid, 0 elsewhere."""
    centres = voxel_centres(scenario.density_grid)
    source = np.zeros(scenario.density_grid.shape_zyx, dtype=np.float32)
    for inlet in scenario.inlets:
        covered = inlet.covers(centres, half_thickness_m=scenario.velocity_grid.voxel_size_m)
        source[covered] = np.maximum(source[covered], inlet.density)
    return source
