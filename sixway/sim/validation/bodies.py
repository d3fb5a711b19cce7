"""Bodies in a wind (drag, vortex shedding), and one that moves through air at rest."""

from dataclasses import dataclass

import numpy as np

from sixway.core.frames import Grid
from sixway.sim.bodies.motion import RigidMotion
from sixway.sim.bodies.shapes import Body, CylinderBody, SphereBody
from sixway.sim.bodies.voxelise import ObstacleField
from sixway.sim.flow.flow import INSIDE, Flow
from sixway.sim.flow.lattice import lattice_named
from sixway.sim.units import LatticeUnits
from sixway.sim.validation.flows import Variant, air_of, all_sides, put_inlets, velocity_of

CELL_M = 0.01
"""Edge of a cell; a second is a step."""


def drawn(flow: Flow, body: Body) -> ObstacleField:
    """A body, as the simulator draws it, in a box with a corner at 0."""
    z, y, x = (n - 2 for n in flow.kind.shape)
    grid = Grid(shape_zyx=(z, y, x), voxel_size_m=CELL_M)
    units = LatticeUnits(dx_m=CELL_M, dt_s=1.0)
    return ObstacleField([body], velocity_grid=grid, density_grid=grid, units=units, device=str(flow.kind.device))


def put_body(flow: Flow, body: Body) -> np.ndarray:
    """Which cells of the box the body fills [z, y, x]."""
    field = drawn(flow, body)
    flow.set_solid(field.solid, field.wall_velocity)
    return field.solid.numpy()[INSIDE] == 1


def blow_from_x_low(flow: Flow, speed: float) -> None:
    """A uniform wind through the box, and an inlet that keeps it up."""
    inlet = np.zeros(flow.kind.shape, dtype=np.int32)
    inlet[..., 0] = 1
    inlet[[0, -1]] = inlet[:, [0, -1]] = 0
    put_inlets(flow, inlet, np.broadcast_to((speed, 0.0, 0.0), (*inlet.shape, 3)))
    flow.set_flow(velocity=(speed, 0.0, 0.0))


SPHERE_WIDTH = 6
"""Width and height of the box around the sphere, in its diameters, between slip sides."""
SPHERE_BLOCKAGE = np.pi / 4.0 / SPHERE_WIDTH**2


def sphere_drag(variant: Variant, *, diameter: int, crossings: float = 10.0) -> float:
    """Drag coefficient of a sphere at Re 100 after the wind has gone `crossings` diameters.

    A quarter of the box, between mirrors; the inlet is 4 diameters before its centre, the open side 6 behind it.
    Re and the coefficient take the diameter of a ball with as many cells.
    """
    speed, half, upstream = 0.1, SPHERE_WIDTH * diameter // 2, 4 * diameter
    shape = (half, half, upstream + 6 * diameter)
    z, y, x = np.indices(shape) + 0.5
    cells = 4 * (z**2 + y**2 + (x - upstream) ** 2 < 0.25 * diameter**2).sum()
    wide = float((6.0 * cells / np.pi) ** (1.0 / 3.0))
    sides = all_sides("slip") | {"x_low": "wall", "x_high": "open"}
    flow = variant.flow(shape, viscosity=speed * wide / 100.0, **sides)
    centre, radius = (upstream * CELL_M, 0.0, 0.0), 0.5 * diameter * CELL_M
    filled = put_body(flow, SphereBody(kind="sphere", centre_m=centre, radius_m=radius))
    assert 4 * filled.sum() == cells
    blow_from_x_low(flow, speed)
    flow.step(int(crossings * diameter / speed))
    return float(4.0 * flow.force_on_solid()[0] / (0.5 * speed**2 * np.pi / 4.0 * wide**2))


CYLINDER_WIDTH = 12
"""Height of the box around the cylinder, in its diameters: a blockage of 8 % between slip sides."""


@dataclass(frozen=True)
class Wake:
    """Velocity across the wind, over the wind's, two diameters behind a cylinder; one sample every `every` steps."""

    times: np.ndarray
    """[diameters that the wind has gone]"""
    across: np.ndarray
    strouhal: float
    """From the last whole periods; NaN if there are not three."""


def cylinder_wake(variant: Variant, *, diameter: int = 12, crossings: float = 100.0, every: int = 20) -> Wake:
    """Vortices behind a cylinder at Re 100, two-dimensional; the wind starts askew, to have them sooner."""
    speed, height, upstream, length = 0.1, CYLINDER_WIDTH * diameter, 6 * diameter, 20 * diameter
    centre = (upstream * CELL_M, 0.0, 0.5 * height * CELL_M)
    flow = variant.flow(
        (height, 1, length),
        viscosity=speed * diameter / 100.0,
        x_low="wall",
        x_high="open",
        z_low="slip",
        z_high="slip",
    )
    put_body(flow, CylinderBody(kind="cylinder", axis="y", centre_m=centre, radius_m=0.5 * diameter * CELL_M))
    blow_from_x_low(flow, speed)
    start = np.zeros((height, 1, length, 3))
    start[..., 0] = speed
    behind = np.exp(-(((np.indices((height, length))[1] - upstream - 2 * diameter) / diameter) ** 2))
    start[:, 0, :, 2] = 0.5 * speed * behind
    flow.set_flow(velocity=start)
    samples = []
    for _ in range(int(crossings * diameter / speed) // every):
        flow.step(every)
        samples.append(velocity_of(flow)[height // 2, 0, upstream + 2 * diameter, 2] / speed)
    times = (1 + np.arange(len(samples))) * every * speed / diameter
    return Wake(times, np.array(samples), _frequency(times, np.array(samples)))


def _frequency(times: np.ndarray, signal: np.ndarray) -> float:
    """Crossings of the mean, upwards, per unit of time in the last half."""
    times, signal = times[len(times) // 2 :], signal[len(signal) // 2 :] - signal[len(signal) // 2 :].mean()
    up = np.flatnonzero((signal[:-1] < 0.0) & (signal[1:] >= 0.0))
    if len(up) < 4:
        return float("nan")
    at = times[up] - signal[up] * (times[up + 1] - times[up]) / (signal[up + 1] - signal[up])
    return float((len(at) - 1) / (at[-1] - at[0]))


def moving_sphere_balance(variant: Variant, *, diameter: int = 8, frames: int = 40) -> float:
    """What is missing between the impulse of a sphere on the air and the air's momentum, as a part of either.

    It moves through a periodic box at a twentieth of a cell a step, drawn anew every four steps, and crosses cells.
    """
    speed, steps = 0.05, 4
    flow = variant.flow((3 * diameter, 3 * diameter, 4 * diameter), viscosity=0.05)
    middle, radius = 1.5 * diameter * CELL_M, 0.5 * diameter * CELL_M
    motion = RigidMotion(kind="rigid", velocity_m_s=(speed * CELL_M, 0.0, 0.0))
    field = drawn(flow, SphereBody(kind="sphere", centre_m=(middle,) * 3, radius_m=radius, motion=motion))
    impulse = 0.0
    for frame in range(frames):
        field.update(frame * steps)
        flow.set_solid(field.solid, field.wall_velocity)
        for _ in range(steps):
            impulse -= flow.force_on_solid()[0]
            flow.step()
        flow.update_velocity()
    g = flow.populations().astype(np.float64)[:, air_of(flow)].sum(axis=1)
    return abs(float(lattice_named(variant.lattice).velocities[:, 0] @ g) / impulse - 1.0)
