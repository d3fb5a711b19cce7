"""Collision, streaming and boundaries of the air."""

import numpy as np
import pytest
import warp as wp

from sixway.sim import kernels, oracle
from sixway.sim.inlets import Gusts
from sixway.sim.lattice import FLUID, INLET, OPEN, SOLID, VELOCITIES, relaxation_time


def run(
    device: str,
    kind: np.ndarray,
    g: np.ndarray,
    velocity: np.ndarray,
    *,
    steps: int,
    tau: float,
    smagorinsky: float = 0.0,
    lift: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """`steps` of the kernel: populations and velocity."""
    lift = np.zeros(kind.shape) if lift is None else lift
    kinds = wp.array(kind, dtype=wp.int32, device=device)
    lifts = wp.array(lift, dtype=wp.float32, device=device)
    wind = wp.array(velocity, dtype=wp.vec3, device=device)
    before = wp.array(g, dtype=wp.float32, device=device)
    after = wp.clone(before)
    for _ in range(steps):
        inputs = [kinds, lifts, tau, smagorinsky, before, after, wind]
        wp.launch(kernels.collide_and_stream, dim=kind.shape, inputs=inputs, device=device)
        before, after = after, before
    return before.numpy(), wind.numpy()


def box(n: int) -> np.ndarray:
    """A cube of n^3 FLUID cells in a SOLID shell."""
    return np.pad(np.full((n, n, n), FLUID), 1, constant_values=SOLID)


def stirred(rng: np.random.Generator, kind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Populations off equilibrium and the velocity that the cells were last seen with."""
    velocity = rng.uniform(-0.1, 0.1, (*kind.shape, 3)) * (kind != SOLID)[..., None]
    g = oracle.equilibrium(rng.uniform(-0.02, 0.02, kind.shape), velocity)
    return g + rng.uniform(-1e-3, 1e-3, g.shape), velocity


@pytest.mark.parametrize("steps", [1, 4])
def test_step_equals_oracle_with_walls_solid_inlet_and_open_top(
    device: str, rng: np.random.Generator, steps: int
) -> None:
    kind = box(8)
    kind[1:-1, -1, 1:-1] = OPEN
    kind[4:6, 5:7, 3:6] = SOLID
    kind[3:6, 1, 3:6] = INLET
    g, velocity = stirred(rng, kind)
    lift = rng.uniform(0.0, 1e-3, kind.shape)
    tau, smagorinsky = 0.502, 0.1
    actual, actual_velocity = run(device, kind, g, velocity, steps=steps, tau=tau, smagorinsky=smagorinsky, lift=lift)
    for _ in range(steps):
        g, velocity = oracle.collide_and_stream(kind, lift, g, velocity, tau=tau, smagorinsky=smagorinsky)
    np.testing.assert_allclose(actual, g, atol=1e-6)
    np.testing.assert_allclose(actual_velocity, velocity, atol=1e-5)


def test_a_closed_box_keeps_its_mass(device: str, rng: np.random.Generator) -> None:
    kind = box(12)
    kind[5:8, 5:8, 5:8] = SOLID
    g, velocity = stirred(rng, kind)
    inside = kind == FLUID
    before = (1.0 + g.sum(axis=0))[inside].sum()
    g, _ = run(device, kind, g, velocity, steps=1000, tau=0.51, smagorinsky=0.1)
    after = (1.0 + g.astype(np.float64).sum(axis=0))[inside].sum()
    assert abs(after / before - 1.0) < 1e-5


@pytest.mark.parametrize("viscosity", [0.01, 0.1])
def test_a_shear_wave_decays_with_the_set_viscosity(device: str, viscosity: float) -> None:
    """u_x = U sin(k y) decays as exp(-nu k^2 t) in a periodic box."""
    n, steps = 32, 200
    kind = np.full((4, n, 4), FLUID)
    k = 2.0 * np.pi / n
    wave = np.sin(k * np.arange(n))[None, :, None]
    velocity = np.zeros((*kind.shape, 3))
    velocity[..., 0] = 0.02 * wave
    g = oracle.equilibrium(np.zeros(kind.shape), velocity)
    amplitudes = []
    for _ in range(2):  # the first stretch forgets the start, which lacks the stress of a moving fluid
        g, velocity = run(device, kind, g, velocity, steps=steps, tau=relaxation_time(viscosity))
        amplitudes.append(np.mean(velocity[..., 0] * wave))
    measured = np.log(amplitudes[0] / amplitudes[1]) / (k**2 * steps)
    assert measured == pytest.approx(viscosity, rel=0.005)


def test_lift_accelerates_free_air_by_that_much(device: str) -> None:
    kind = np.full((4, 4, 4), FLUID)
    still = np.zeros((*kind.shape, 3))
    lift = np.full(kind.shape, 1e-4)
    g, velocity = run(device, kind, np.zeros((19, *kind.shape)), still, steps=100, tau=0.6, lift=lift)
    np.testing.assert_allclose(velocity[..., 1], 99.5e-4, rtol=1e-3)  # u is taken half-way through a step
    momentum = np.einsum("qa,qzyx->zyxa", VELOCITIES, g)
    np.testing.assert_allclose(momentum[..., 1], 1e-2, rtol=1e-3)


def test_inlets_blow_their_mean_and_their_own_gusts(device: str, rng: np.random.Generator) -> None:
    cells = np.array([[1, 2, 3], [4, 0, 2], [3, 3, 3]])  # x, y, z
    inlet, mean, time = np.array([0, 1, 0]), rng.uniform(-0.1, 0.1, (3, 3)), 1234.0
    draws = [Gusts.draw(rng, radius=3.0, speed=0.1, turbulence=0.3) for _ in range(2)]
    modes = {name: np.stack([getattr(d, name) for d in draws]) for name in ("wave", "amplitude", "frequency", "phase")}
    velocity = wp.zeros((5, 5, 5), dtype=wp.vec3, device=device)
    dtypes = [wp.vec3i, wp.int32, wp.vec3, wp.vec3, wp.vec3, wp.float32, wp.float32]
    arrays = [
        wp.array(values, dtype=dtype, device=device)
        for values, dtype in zip([cells, inlet, mean, *modes.values()], dtypes, strict=True)
    ]
    wp.launch(kernels.blow, dim=3, inputs=[*arrays, time, velocity], device=device)
    expected = np.zeros((5, 5, 5, 3))
    for (x, y, z), owner, steady in zip(cells, inlet, mean, strict=True):
        own = {name: values[owner] for name, values in modes.items()}
        expected[z, y, x] = steady + oracle.gusts(np.array([[x, y, z]]), **own, time=time)[0]
    np.testing.assert_allclose(velocity.numpy(), expected, atol=1e-5)
