"""The simulation: air, bodies, smoke and fire, and the order in which they act on one another."""

from collections.abc import Iterator, Mapping

import numpy as np
import warp as wp

from sixway.core.records import DensityFrame
from sixway.sim.bodies.voxelise import ObstacleField
from sixway.sim.carried.burn import Burner
from sixway.sim.carried.forces import Forces
from sixway.sim.carried.scalars import Scalars
from sixway.sim.flow.flow import INSIDE, Flow, MakeFlow
from sixway.sim.flow.lattice import SOUND_SPEED
from sixway.sim.flow.watch import Watch
from sixway.sim.gusts import blow
from sixway.sim.placement import SmokeSources, first_wind, imposed_cells
from sixway.sim.scenario import ScenarioConfig


class FlowError(RuntimeError):
    """The flow blew up; the message tells the step and what to change."""


class SmokeSolver:
    """Simulates one scenario on one device; the same scenario and device give the same bytes.

    threads: CPU threads; they change no byte. make_flow: `Flow`, or what knows more encodings than populations.

    >>> for frame in SmokeSolver(scenario, device="cpu").frames():  # doctest: +SKIP
    ...     save(frame)
    """

    def __init__(self, scenario: ScenarioConfig, *, device: str, threads: int = 1, make_flow: MakeFlow = Flow) -> None:
        self.scenario = scenario
        self.frames_done = 0
        self._timing = scenario.timing
        self._units = units = self._timing.units
        self._device = wp.get_device(device)
        velocity_grid, density_grid = scenario.velocity_grid, scenario.density_grid
        cells = velocity_grid.shape_zyx

        self._bodies = ObstacleField(
            scenario.obstacles,
            velocity_grid=velocity_grid,
            density_grid=density_grid,
            units=units,
            device=device,
            threads=threads,
        )
        viscosity = units.viscosity_to_lattice(scenario.viscosity_m2_s)
        self._flow = make_flow(scenario.flow, shape_zyx=cells, viscosity=viscosity, device=device, threads=threads)
        self._flow.set_flow(velocity=first_wind(scenario))
        self._make_inlets()
        self._flow.set_solid(self._bodies.solid, self._bodies.wall_velocity)
        self._flow.update_velocity()

        smoke = scenario.smoke
        self._scalars = Scalars(
            scenario.scalar_names,
            shape_zyx=cells,
            refinement=scenario.refinement,
            scheme=smoke.scheme,
            faces=scenario.scalar_faces,
            device=device,
            threads=threads,
        )
        lifts = {"density": smoke.buoyancy_m_s2, "temperature": smoke.heat_buoyancy_m_s2_k}
        confinement = smoke.vorticity_confinement * scenario.lattice_speed / max(cells)
        self._forces = Forces(
            self._scalars,
            lifts={n: units.acceleration_to_lattice(a) for n, a in lifts.items() if n in self._scalars.names},
            confinement=confinement,
            device=device,
            threads=threads,
        )
        self._burner = Burner(scenario.burn, self._scalars, device=device, threads=threads) if scenario.burn else None
        if self._burner is not None:
            self._flow.growth = self._burner.mass_source
        self._sources = SmokeSources(scenario)
        self._fed: tuple[tuple[int, ...], dict[str, wp.array]] | None = None
        self._watch = Watch(limit=SOUND_SPEED, device=device)

    @property
    def time_s(self) -> float:
        """Simulated since the start [s]."""
        return self._flow.steps * self._units.dt_s

    def frames(self) -> Iterator[DensityFrame]:
        """Warm up, then yield `scenario.frames` frames. Raises FlowError if the flow blows up."""
        for _ in range(self.scenario.warmup_frames):
            self.advance()
        for _ in range(self.scenario.frames):
            self.advance()
            yield self.frame()

    def advance(self) -> None:
        """Run to the next frame. Raises FlowError, naming the step and the remedy, if the flow blew up."""
        for _ in range(self._timing.steps_per_frame // self._timing.steps_per_advection):
            self.step()
        self._check_stable()  # the one wait for the device in a frame
        self.frames_done += 1

    def step(self) -> None:
        """Move the air by `steps_per_advection` lattice steps and then smoke, heat and fire with it."""
        count = self._timing.steps_per_advection
        seconds = count * self._units.dt_s
        self._place_bodies()
        self._forces.update(self._flow.velocity, self._flow.force)
        self._blow()
        self._flow.step(count)
        self._flow.update_velocity()
        self._watch.look(self._flow.velocity, self._flow.steps)
        self._scalars.advect(self._flow.velocity, steps=float(count), solid_fraction=self._bodies.fraction)
        self._feed(seconds)
        self._fade(seconds)
        if self._burner is not None:
            self._burner.burn(seconds=seconds, steps=float(count))

    def frame(self) -> DensityFrame:
        """The smoke now; `time_s` counts from the moment when the inlets opened."""
        velocity = np.ascontiguousarray(self._flow.velocity.numpy()[INSIDE])
        return DensityFrame(
            density=self._scalars.fields["density"].numpy().copy(),
            grid=self.scenario.density_grid,
            time_s=self.time_s,
            velocity_m_s=velocity * np.float32(self._units.velocity_m_s),
            obstacle=self._bodies.fraction.numpy().copy() if self.scenario.obstacles else None,
            emission=None if self._burner is None else self._burner.emission().numpy().copy(),
        )

    def state(self) -> dict[str, np.ndarray]:
        """All that `restore` needs to go on with the same bytes. Waits for the device."""
        flow = {f"flow.{name}": array for name, array in self._flow.state().items()}
        burner = {} if self._burner is None else {"mass_source": self._burner.mass_source.numpy().copy()}
        return {**flow, **self._scalars.state(), **burner, "frames_done": np.array(self.frames_done)}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a `state` of the same scenario. Raises ValueError if an array does not fit."""
        if "frames_done" not in state or (self._burner is not None and "mass_source" not in state):
            raise ValueError("the state is not one of this scenario: it lacks frames_done or mass_source")
        self._flow.restore({name.removeprefix("flow."): a for name, a in state.items() if name.startswith("flow.")})
        self._scalars.restore(state)
        if self._burner is not None:
            self._burner.mass_source.assign(state["mass_source"])
        self.frames_done = int(state["frames_done"])
        self._bodies.update(self.time_s)

    def _place_bodies(self) -> None:
        """Moving bodies go to where they are in the middle of the coming steps."""
        if self._bodies.moving:
            self._bodies.update(self.time_s + 0.5 * self._timing.steps_per_advection * self._units.dt_s)
            self._flow.set_solid(self._bodies.solid, self._bodies.wall_velocity)

    def _blow(self) -> None:
        cells = len(self._inlets[0])
        inputs = [*self._inlets, float(self._flow.steps), self._flow.imposed]
        wp.launch(blow, dim=cells, inputs=inputs, device=self._device)

    def _feed(self, seconds: float) -> None:
        now = self._flow.steps * self._units.dt_s
        puffs = self._sources.active(since_s=now - seconds, until_s=now)
        if self._fed is None or self._fed[0] != puffs:
            fields = self._sources.fields(puffs)
            self._fed = puffs, {name: self._put(field, wp.float32) for name, field in fields.items()}
        for name, source in self._fed[1].items():
            self._scalars.feed(name, source)

    def _fade(self, seconds: float) -> None:
        smoke = self.scenario.smoke
        self._scalars.dissipate("density", rate_per_s=smoke.dissipation_per_s, seconds=seconds)
        if "temperature" in self._scalars.names:
            self._scalars.cool(
                "temperature",
                rate_per_s=smoke.cooling_per_s,
                radiation_k_per_s=smoke.radiation_k_per_s,
                hottest_k=self.scenario.burn.hottest_k if self.scenario.burn else 1000.0,
                seconds=seconds,
            )

    def _check_stable(self) -> None:
        broken = self._watch.broken_step()
        if broken is None:
            return
        scenario = self.scenario
        raise FlowError(
            f"scenario {scenario.name!r} blew up at lattice step {broken} (frame {self.frames_done}): the air is not "
            f"finite or reaches {SOUND_SPEED:.3g} cells/step, the speed of sound; lower "
            f"lattice_speed={scenario.lattice_speed}, raise flow.smagorinsky={scenario.flow.smagorinsky} (0.1 is "
            f"safe), raise viscosity_m2_s={scenario.viscosity_m2_s}, or raise speed_m_s if fire or buoyancy drives it"
        )

    def _make_inlets(self) -> None:
        """Arrays of `blow`: one row per INLET cell, one row of gusts per source."""
        imposed = imposed_cells(self.scenario)
        x, y, z = imposed.cell.T
        inlet = np.zeros(self._flow.kind.shape, np.int32)
        inlet[z, y, x] = 1
        self._flow.set_inlets(self._put(inlet, wp.int32))
        gusts = imposed.gusts
        self._inlets = [
            self._put(imposed.cell.astype(np.int32), wp.vec3i),
            self._put(imposed.source.astype(np.int32), wp.int32),
            self._put(imposed.mean, wp.vec3),
            self._put(_stacked([g.wave for g in gusts], 3), wp.vec3),
            self._put(_stacked([g.amplitude for g in gusts], 3), wp.vec3),
            self._put(_stacked([g.frequency for g in gusts]), wp.float32),
            self._put(_stacked([g.phase for g in gusts]), wp.float32),
        ]

    def _put(self, values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(values, dtype=dtype, device=self._device)


def _stacked(rows: list[np.ndarray], *components: int) -> np.ndarray:
    """One row per source; an array without rows where there is no source."""
    return np.stack(rows) if rows else np.zeros((0, 1, *components))
