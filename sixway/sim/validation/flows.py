"""Flows in boxes whose answer is known: Taylor-Green, Poiseuille, Couette, the lid-driven cavity, a shear layer."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import warp as wp
from pydantic import ValidationError

from sixway.sim.flow import oracle
from sixway.sim.flow.faces import Face, Faces, MovingWall
from sixway.sim.flow.flow import INSIDE, Flow, FlowConfig, MakeFlow
from sixway.sim.flow.lattice import FLUID, CollisionModel, LatticeName, lattice_named


def all_sides(face: Face) -> dict[str, Any]:
    """The same face on every side of the box, as arguments of `Faces`."""
    return {f"{axis}_{end}": face for axis in "xyz" for end in ("low", "high")}


@dataclass(frozen=True)
class Variant:
    """A way to compute air: lattice and collision model, as populations or as ten moments a cell.

    make_flow: `Flow`, or what knows moments too.
    """

    lattice: LatticeName
    model: CollisionModel
    moments: bool = False
    device: str = "cpu"
    threads: int = 1
    make_flow: MakeFlow = Flow

    @property
    def name(self) -> str:
        return f"{self.lattice} {self.model}" + (", ten moments" if self.moments else "")

    def flow(
        self, shape_zyx: tuple[int, int, int], *, viscosity: float, smagorinsky: float = 0.0, **sides: Face
    ) -> Flow:
        """Air at rest; sides of the box that are not named are periodic. No eddy viscosity unless asked for."""
        faces = Faces(**(all_sides("periodic") | sides))
        config = FlowConfig(
            lattice=self.lattice,
            model=self.model,
            smagorinsky=smagorinsky,
            streaming="two_grids" if self.moments else "in_place",
            encoding="moments" if self.moments else "populations",
            faces=faces,
        )
        return self.make_flow(
            config, shape_zyx=shape_zyx, viscosity=viscosity, device=self.device, threads=self.threads
        )


def offered(*, device: str = "cpu", threads: int = 1, make_flow: MakeFlow = Flow) -> Iterator[Variant]:
    """All that a user can ask for, of what `make_flow` knows."""
    for lattice in get_args(LatticeName):
        for model in get_args(CollisionModel):
            for moments in (False, True):
                variant = Variant(lattice, model, moments, device, threads, make_flow)
                try:
                    variant.flow((1, 1, 1), viscosity=0.1)
                except (ValidationError, ValueError):
                    continue  # a model that needs the other lattice, or that moments cannot stand for
                yield variant


def velocity_of(flow: Flow) -> np.ndarray:
    """Velocity of the box [z, y, x, 3], float64."""
    flow.update_velocity()
    return flow.velocity.numpy()[INSIDE].astype(np.float64)


def push(flow: Flow, acceleration_x: float) -> None:
    force = np.zeros(flow.force.shape, dtype=np.float32)
    force[0] = acceleration_x
    flow.force.assign(force)


def put_inlets(flow: Flow, inlet: np.ndarray, velocity: np.ndarray) -> None:
    """INLET where `inlet` [z, y, x], with shell; it blows at `velocity` [z, y, x, 3]."""
    flow.set_inlets(wp.array(inlet, dtype=wp.int32, device=flow.kind.device))
    imposed = flow.imposed.numpy().copy()
    imposed[inlet != 0] = velocity[inlet != 0]
    flow.imposed.assign(imposed)


def put_solid(flow: Flow, solid: np.ndarray, wall_velocity: np.ndarray | float = 0.0) -> None:
    velocity = np.zeros((*solid.shape, 3), dtype=np.float32)
    velocity[:] = wall_velocity
    device = flow.kind.device
    flow.set_solid(wp.array(solid, dtype=wp.int32, device=device), wp.array(velocity, dtype=wp.vec3, device=device))


def air_of(flow: Flow) -> np.ndarray:
    """Which cells are air, with the shell, none of which is."""
    air = np.zeros(flow.kind.shape, dtype=bool)
    air[INSIDE] = flow.kind.numpy()[INSIDE] == FLUID
    return air


def taylor_green(variant: Variant, *, cells: int = 64, speed: float = 0.02, viscosity: float = 0.01) -> float:
    """Error of the viscosity by which four vortices in a periodic square lose half of their energy."""
    k = 2.0 * np.pi / cells
    y, x = k * (np.indices((cells, cells)) + 0.5)
    u = np.zeros((1, cells, cells, 3))
    u[0, ..., 0], u[0, ..., 1] = speed * np.cos(x) * np.sin(y), -speed * np.sin(x) * np.cos(y)
    flow = variant.flow((1, cells, cells), viscosity=viscosity)
    flow.set_flow(velocity=u, density=1.0 - 0.75 * speed**2 * (np.cos(2.0 * x) + np.cos(2.0 * y))[None])
    flow.step(200)  # the stress of a flow that starts as an equilibrium has to build up
    before = (velocity_of(flow) ** 2).sum()
    steps = int(np.log(2.0) / (4.0 * viscosity * k**2))
    flow.step(steps)
    after = (velocity_of(flow) ** 2).sum()
    return abs(float(np.log(before / after)) / (4.0 * k**2 * steps) / viscosity - 1.0)


def poiseuille(variant: Variant, *, cells: int = 16, viscosity: float = 1 / 30, smagorinsky: float = 0.0) -> float:
    """Greatest error of the parabola that a body force drives between two walls, as a part of its peak."""
    peak = 0.02
    flow = variant.flow((1, cells, 4), viscosity=viscosity, smagorinsky=smagorinsky, y_low="wall", y_high="wall")
    push(flow, 8.0 * viscosity * peak / cells**2)
    flow.step(int(0.8 * cells**2 / viscosity))
    y = (np.arange(cells) + 0.5) / cells
    return float(np.abs(velocity_of(flow)[0, :, 0, 0] - 4.0 * peak * y * (1.0 - y)).max()) / peak


def open_channel(variant: Variant, *, cells: int = 16) -> tuple[float, float]:
    """A parabola blown in at one end that leaves through an open side.

    Greatest error after three quarters of the way, as a part of the peak; and the error of the pressure's slope in
    the middle half, given how much really flows.
    """
    peak, viscosity, length = 0.04, 0.1, 4 * cells
    flow = variant.flow(
        (1, cells, length), viscosity=viscosity, x_low="wall", x_high="open", y_low="wall", y_high="wall"
    )
    y = (np.arange(cells + 2) - 0.5) / cells
    parabola = 4.0 * peak * y * (1.0 - y)
    inlet = np.zeros(flow.kind.shape, dtype=np.int32)
    inlet[1:-1, 1:-1, 0] = 1
    wind = np.zeros((*inlet.shape, 3))
    wind[..., 0] = parabola[:, None]
    put_inlets(flow, inlet, wind)
    flow.step(int(16.0 * cells**2 / viscosity))
    u = velocity_of(flow)[0, :, 3 * length // 4, 0]
    density = flow.density.numpy()[INSIDE][0].mean(axis=0, dtype=np.float64)[length // 4 : 3 * length // 4]
    slope = np.polyfit(np.arange(density.size), np.log(density) / 3.0, 1)[0]  # of the pressure, over the density
    wanted = -8.0 * viscosity * peak / cells**2 * u.mean() / parabola[1:-1].mean()
    return float(np.abs(u - parabola[1:-1]).max()) / peak, abs(float(slope / wanted) - 1.0)


def couette(variant: Variant, *, cells: int = 16, viscosity: float = 0.01) -> float:
    """Greatest error while a wall that slides sets air into motion, as a part of its speed, by Fourier's series."""
    speed = 0.05
    lid = MovingWall(velocity=(speed, 0.0, 0.0))
    flow = variant.flow((1, cells, 4), viscosity=viscosity, y_low="wall", y_high=lid)
    steps = int(0.1 * cells**2 / viscosity)
    flow.step(steps)
    y, n = (np.arange(cells) + 0.5) / cells, np.arange(1, 50)[:, None]
    decay = np.exp(-((n * np.pi) ** 2) * viscosity * steps / cells**2)
    series = y + (2.0 / (n * np.pi) * (-1.0) ** n * decay * np.sin(n * np.pi * y)).sum(axis=0)
    return float(np.abs(velocity_of(flow)[0, :, 0, 0] / speed - series).max())


# fmt: off
GHIA_Y = (0.0547, 0.0625, 0.0703, 0.1016, 0.1719, 0.2813, 0.4531, 0.5000,
          0.6172, 0.7344, 0.8516, 0.9531, 0.9609, 0.9688, 0.9766)
GHIA_U = {
    100: (-0.03717, -0.04192, -0.04775, -0.06434, -0.10150, -0.15662, -0.21090, -0.20581,
          -0.13641, 0.00332, 0.23151, 0.68717, 0.73722, 0.78871, 0.84123),
    1000: (-0.18109, -0.20196, -0.22220, -0.29730, -0.38289, -0.27805, -0.10648, -0.06080,
           0.05702, 0.18719, 0.33304, 0.46604, 0.51117, 0.57492, 0.65928),
}
GHIA_X = (0.0625, 0.0703, 0.0781, 0.0938, 0.1563, 0.2266, 0.2344, 0.5000,
          0.8047, 0.8594, 0.9063, 0.9453, 0.9531, 0.9609, 0.9688)
GHIA_V = {
    100: (0.09233, 0.10091, 0.10890, 0.12317, 0.16077, 0.17507, 0.17527, 0.05454,
          -0.24533, -0.22445, -0.16914, -0.10313, -0.08864, -0.07391, -0.05906),
    1000: (0.27485, 0.29012, 0.30353, 0.32627, 0.37095, 0.33075, 0.32235, 0.02526,
           -0.31966, -0.42665, -0.51550, -0.39188, -0.33714, -0.27669, -0.21388),
}
# fmt: on
"""Velocities through the middle of the cavity, u(y) and v(x), over the lid's: Ghia, Ghia & Shin 1982, Tables I and II,
without the walls."""


@dataclass(frozen=True)
class Cavity:
    """Velocities through its middle, over the lid's, at `places` from wall to wall; their distance from the tables."""

    places: np.ndarray
    u: np.ndarray
    v: np.ndarray
    rms: float


def cavity(
    variant: Variant, reynolds: int, *, cells: int = 64, crossings: float = 50.0, smagorinsky: float = 0.0
) -> Cavity:
    """Square, two-dimensional, after the lid has gone `crossings` times its length. rms: NaN if the flow broke up."""
    speed = 0.1
    flow = variant.flow(
        (1, cells, cells),
        viscosity=speed * cells / reynolds,
        smagorinsky=smagorinsky,
        x_low="wall",
        x_high="wall",
        y_low="wall",
        y_high=MovingWall(velocity=(speed, 0.0, 0.0)),
    )
    flow.step(int(crossings * cells / speed))
    air, middle = velocity_of(flow)[0] / speed, cells // 2
    places = np.concatenate([[0.0], (np.arange(cells) + 0.5) / cells, [1.0]])
    u = np.concatenate([[0.0], 0.5 * (air[:, middle - 1, 0] + air[:, middle, 0]), [1.0]])
    v = np.concatenate([[0.0], 0.5 * (air[middle - 1, :, 1] + air[middle, :, 1]), [0.0]])
    errors = [np.interp(GHIA_Y, places, u) - GHIA_U[reynolds], np.interp(GHIA_X, places, v) - GHIA_V[reynolds]]
    return Cavity(places, u, v, float(np.sqrt(np.mean(np.square(errors)))))


def mass_drift(variant: Variant, *, cells: int = 16, steps: int = 1000) -> float:
    """What a closed box with a block in it loses or gains of its mass, stirred at a tenth of a cell a step."""
    rng = np.random.default_rng(3)
    box = (cells,) * 3
    flow = variant.flow(box, viscosity=0.002, smagorinsky=0.1, **all_sides("wall"))
    solid = np.zeros(flow.kind.shape, dtype=np.int32)
    solid[(slice(cells // 3, cells // 2),) * 3] = 1
    put_solid(flow, solid)
    flow.set_flow(velocity=rng.uniform(-0.1, 0.1, (*box, 3)), density=rng.uniform(0.97, 1.03, box))
    air = air_of(flow)

    def mass() -> float:
        return float((1.0 + flow.populations().astype(np.float64).sum(axis=0))[air].sum())

    before = mass()
    flow.step(steps)
    return abs(mass() / before - 1.0)


def difference_from_oracle(variant: Variant, *, steps: int = 3) -> float:
    """Greatest difference of a population from the float64 twin: a box with every kind of side and moving blocks.

    Of ten moments without inlets and open sides, where they differ by design.
    """
    rng = np.random.default_rng(7)
    shape, slide = (6, 7, 9), MovingWall(velocity=(0.05, 0.0, 0.02))
    y_high: Face = "wall" if variant.moments else "open"
    flow = variant.flow(shape, viscosity=0.02, smagorinsky=0.1, y_low=slide, y_high=y_high, z_low="slip", z_high="slip")
    solid = np.zeros(flow.kind.shape, dtype=np.int32)
    if not variant.moments:
        inlet = np.zeros_like(solid)
        inlet[3:5, 1, 2:4] = 1
        put_inlets(flow, inlet, np.broadcast_to((0.03, 0.05, -0.02), (*inlet.shape, 3)))
    solid[3:5, 3:6, 4:6] = 1
    solid[1:3, 5:7, 8:] = 1
    put_solid(flow, solid, rng.uniform(-0.05, 0.05, (*solid.shape, 3)))
    flow.force.assign(rng.uniform(-1e-3, 1e-3, flow.force.shape))
    flow.set_flow(velocity=rng.uniform(-0.1, 0.1, (*shape, 3)), density=rng.uniform(0.97, 1.03, shape))

    kind = flow.kind.numpy().astype(int)
    imposed, force = flow.imposed.numpy().astype(float), flow.force.numpy().astype(float)
    g, air = flow.populations().astype(float), air_of(flow)
    flow.step(steps)
    for _ in range(steps):
        g = oracle.step(
            lattice_named(variant.lattice), variant.model, kind, imposed, force, g, tau=0.56, smagorinsky=0.1
        )
    return float(np.abs(flow.populations() - g)[:, air].max())
