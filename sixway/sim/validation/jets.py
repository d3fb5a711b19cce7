"""Jets, at no viscosity and through open sides, and what open sides reflect."""

from dataclasses import dataclass

import numpy as np

from sixway.sim.flow.flow import INSIDE, Flow
from sixway.sim.validation.flows import Variant, air_of, all_sides, put_inlets, put_solid, velocity_of


@dataclass(frozen=True)
class Survival:
    """A jet after its run. Speeds over the inlet's; NaN in all of them once it broke up.

    checkerboard: see `checkerboard`, worst axis, mean over the second half of the run.
    spin: vorticity about z in the middle plane [y, x] at the end, times the inlet's width over its speed.
    """

    fastest: float
    least_density: float
    most_density: float
    checkerboard: float
    spin: np.ndarray


def jet_without_viscosity(
    variant: Variant, *, speed: float, smagorinsky: float, cells: int = 32, steps: int = 5000, samples: int = 10
) -> Survival:
    """A jet of a quarter of the box's width against a ball of the same width; closed sides, open above.

    Every cell of the inlet blows a little aside, by chance (5 % of its speed, seeded).
    """
    rng = np.random.default_rng(0)
    sides = all_sides("wall") | {"y_high": "open"}
    flow = variant.flow((cells,) * 3, viscosity=0.0, smagorinsky=smagorinsky, **sides)
    z, y, x = np.indices(flow.kind.shape) - 0.5 * (cells + 1)
    inlet = (np.hypot(x, z) < cells / 8) & (y < -0.5 * cells)
    wind = 0.05 * speed * rng.standard_normal((*inlet.shape, 3)) + (0.0, speed, 0.0)
    put_inlets(flow, inlet.astype(np.int32), wind)
    put_solid(flow, (x**2 + y**2 + (z - 0.02 * cells) ** 2 < (cells / 8) ** 2).astype(np.int32))
    air, boards = air_of(flow)[INSIDE], []
    for _ in range(samples):
        flow.step(steps // samples)
        u = velocity_of(flow)
        if not np.isfinite(u[air]).all():
            nothing = float("nan")
            return Survival(nothing, nothing, nothing, nothing, spin=np.full((cells, cells), np.nan))
        boards.append(checkerboard(u, air))
    density = flow.density.numpy()[INSIDE][air]
    return Survival(
        fastest=float(np.linalg.norm(u[air], axis=-1).max() / speed),
        least_density=float(density.min()),
        most_density=float(density.max()),
        checkerboard=float(np.mean(boards[samples // 2 :])),
        spin=(np.gradient(u[..., 1], axis=2) - np.gradient(u[..., 0], axis=1))[cells // 2] * cells / 4 / speed,
    )


def checkerboard(u: np.ndarray, air: np.ndarray) -> float:
    """Energy of waves two cells long over that of waves four cells long, of the worst axis.

    Both by third differences along an axis, (u0 - 3 u1 + 3 u2 - u3) / 8, between neighbours and between every second
    cell, where all seven cells are air: each is 1 for the wave it looks for. 1/64 for a smooth flow, 1 for noise,
    beyond any bound for a checkerboard.
    """

    def worst(axis: int) -> float:
        v, inside = np.moveaxis(u, axis, 0), np.moveaxis(air, axis, 0)
        n = len(v) - 6
        seven = np.all([inside[i : i + n] for i in range(7)], axis=0)
        short, long = (
            np.sum([factor * v[i * stride : i * stride + n] for i, factor in enumerate((1, -3, 3, -1))], axis=0)[seven]
            for stride in (1, 2)
        )
        return float((short**2).sum() / max(float((long**2).sum()), 1e-30))

    return max(worst(axis) for axis in range(3))


def reflected_pulse(variant: Variant) -> float:
    """What two open sides throw back of a plane pulse of pressure, over its height.

    Told by a box whose sides are too far away to answer.
    """

    def pulse(cells: int, shift: int) -> np.ndarray:
        flow = variant.flow((2, 2, cells), viscosity=0.005, x_low="open", x_high="open")
        x = np.arange(cells) - shift - 39.5
        flow.set_flow(velocity=(0.0, 0.0, 0.0), density=1.0 + 0.01 * np.exp(-(x**2) / 50.0))
        flow.step(120)
        flow.update_velocity()
        return flow.density.numpy()[1, 1, 1:-1][shift : shift + 80]

    return float(np.abs(pulse(80, 0) - pulse(240, 80)).max() / 0.005)


def jet_through_an_open_side(variant: Variant, *, cells: int = 24, smagorinsky: float = 0.0) -> float:
    """How far an open side disturbs a laminar jet (Re 50) that leaves through it, over the speed of the jet.

    Root mean square in the half before the side, against a box twice as long.
    """
    speed, wide = 0.1, cells / 3

    def blown(length: int) -> np.ndarray:
        sides = all_sides("wall") | {"x_high": "open"}
        flow = variant.flow((cells, cells, length), viscosity=speed * wide / 50.0, smagorinsky=smagorinsky, **sides)
        blow_jet(flow, speed, 0.5 * wide)
        flow.step(int(6.0 * cells / speed))
        return velocity_of(flow)

    short, long = blown(2 * cells), blown(4 * cells)
    half = slice(cells, 2 * cells)
    return float(np.sqrt(((short[:, :, half] - long[:, :, half]) ** 2).sum(axis=-1).mean())) / speed


def blow_jet(flow: Flow, speed: float, radius: float) -> None:
    """A round inlet of even speed in the middle of side x_low."""
    z, y, x = np.indices(flow.kind.shape)
    middle_z, middle_y = (0.5 * (n - 1) for n in flow.kind.shape[:2])
    inlet = (np.hypot(z - middle_z, y - middle_y) < radius) & (x == 0)
    put_inlets(flow, inlet.astype(np.int32), np.broadcast_to((speed, 0.0, 0.0), (*inlet.shape, 3)))
