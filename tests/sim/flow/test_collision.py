"""Collision models: C++ against the float64 oracle, conservation, symmetry, viscosity, force, a lid at Re 1000."""

import itertools
from functools import cache

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from sixway.sim.flow import collision
from sixway.sim.flow import collision_oracle as oracle
from sixway.sim.flow.faces import Faces, MovingWall
from sixway.sim.flow.flow import Flow, FlowConfig
from sixway.sim.flow.lattice import D3Q19, D3Q27, Lattice, lattice_named

OFFERED = [
    ("D3Q19", "bgk"),
    ("D3Q27", "bgk"),
    ("D3Q19", "regularised"),
    ("D3Q27", "regularised"),
    ("D3Q27", "third_order"),
]
every_model = pytest.mark.parametrize(("name", "model"), OFFERED)


@cache
def collision_kernel(name: str, model: str) -> wp.Kernel:
    """Collides one cell a thread; populations [cell, q], acceleration and results (rho, ux, uy, uz) [cell, .]."""
    q_count = len(lattice_named(name).weights)
    snippet = f"""
        {" ".join(f"float f{q} = g.data[n * {q_count} + {q}];" for q in range(q_count))}
        const float ax = acceleration.data[3 * n], ay = acceleration.data[3 * n + 1], az = acceleration.data[3 * n + 2];
        {collision.text(lattice_named(name), model)}
        {" ".join(f"after.data[n * {q_count} + {q}] = f{q};" for q in range(q_count))}
        float* const out = macroscopic.data + 4 * n;
        out[0] = rho; out[1] = ux; out[2] = uy; out[3] = uz;
    """

    @wp.func_native(snippet)
    def collide_cell(
        g: wp.array2d[wp.float32],
        acceleration: wp.array2d[wp.float32],
        tau: float,
        smagorinsky: float,
        after: wp.array2d[wp.float32],
        macroscopic: wp.array2d[wp.float32],
        n: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def collide(
        g: wp.array2d[wp.float32],
        acceleration: wp.array2d[wp.float32],
        tau: float,
        smagorinsky: float,
        after: wp.array2d[wp.float32],
        macroscopic: wp.array2d[wp.float32],
    ):
        collide_cell(g, acceleration, tau, smagorinsky, after, macroscopic, wp.tid())

    return collide


def collide(name, model, g, acceleration, *, tau, smagorinsky, device="cpu"):
    """The C++ on populations [q, cell] and acceleration [3, cell]: populations, density, velocity."""
    source = [wp.array(np.ascontiguousarray(a.T), dtype=wp.float32, device=device) for a in (g, acceleration)]
    after, macroscopic = wp.zeros_like(source[0]), wp.zeros((g.shape[1], 4), dtype=wp.float32, device=device)
    kernel = collision_kernel(name, model)
    wp.launch(kernel, dim=g.shape[1], inputs=[*source, tau, smagorinsky], outputs=[after, macroscopic], device=device)
    found = macroscopic.numpy().astype(np.float64).T
    return after.numpy().astype(np.float64).T, found[0], found[1:]


def disturbed(lattice: Lattice, rng: np.random.Generator, cells: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Populations of moving air far from equilibrium, as float32 has them, and accelerations."""
    density = 1.0 + 0.05 * rng.standard_normal(cells)
    u = 0.1 * rng.standard_normal((3, cells))
    cu = lattice.velocities @ u
    f = lattice.weights[:, None] * density * (1.0 + 3.0 * cu + 4.5 * cu**2 - 1.5 * (u**2).sum(axis=0))
    g = f - lattice.weights[:, None] + 0.05 * lattice.weights[:, None] * rng.standard_normal(f.shape)
    return tuple(a.astype(np.float32).astype(np.float64) for a in (g, 0.01 * rng.standard_normal((3, cells))))


@every_model
@pytest.mark.parametrize(("tau", "smagorinsky"), [(0.5, 0.0), (0.5, 0.1), (0.8, 0.0), (1.7, 0.17)])
def test_text_equals_the_oracle(name, model, tau, smagorinsky, device, rng) -> None:
    lattice = lattice_named(name)
    g, acceleration = disturbed(lattice, rng)
    expected = oracle.collide(lattice, model, g, acceleration, tau=tau, smagorinsky=smagorinsky)
    for found, wanted in zip(
        collide(name, model, g, acceleration, tau=tau, smagorinsky=smagorinsky, device=device), expected, strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6)


@every_model
def test_collision_keeps_mass_and_adds_the_force_to_momentum(name, model, rng) -> None:
    lattice = lattice_named(name)
    g, acceleration = disturbed(lattice, rng)
    after, density, u = oracle.collide(lattice, model, g, acceleration, tau=0.51, smagorinsky=0.1)
    momentum = lattice.velocities.T @ g
    np.testing.assert_allclose(after.sum(axis=0), g.sum(axis=0), atol=1e-14)
    np.testing.assert_allclose(lattice.velocities.T @ after, momentum + density * acceleration, atol=1e-14)
    np.testing.assert_allclose(density * u, momentum + 0.5 * density * acceleration, atol=1e-14)
    single = collide(name, model, g, acceleration, tau=0.51, smagorinsky=0.1)[0]
    np.testing.assert_allclose(single.sum(axis=0), g.sum(axis=0), atol=3e-7)
    np.testing.assert_allclose(lattice.velocities.T @ single, momentum + density * acceleration, atol=3e-7)


@every_model
def test_force_enters_the_stress_to_second_order(name, model, rng) -> None:
    """Air whose stress about u is 0 gains u F + F u of second moments, at any rate: no more, no less (Guo 2002)."""
    lattice = lattice_named(name)
    density, u, force = 1.1, np.array([0.03, -0.02, 0.05]), np.array([0.01, 0.02, -0.005])
    c = lattice.velocities
    start = density * u - 0.5 * force  # so that u is the velocity in the middle of the step
    second = density * (np.eye(3) / 3 + np.outer(u, u)) - 0.5 * (np.outer(u, force) + np.outer(force, u))
    h2 = np.einsum("qa,qb->qab", c, c) - np.eye(3) / 3
    f = lattice.weights * (density + 3 * c @ start + 4.5 * np.einsum("qab,ab->q", h2, second - density * np.eye(3) / 3))
    g = (f - lattice.weights)[:, None]
    for tau in (0.5, 0.6, 2.0):
        after = oracle.collide(lattice, model, g, (force / density)[:, None], tau=tau, smagorinsky=0.0)[0][:, 0]
        found = np.einsum("qa,qb,q->ab", c, c, after + lattice.weights)
        np.testing.assert_allclose(found - second, np.outer(u, force) + np.outer(force, u), atol=1e-14)


@every_model
@settings(max_examples=20, deadline=None)
@given(
    order=st.permutations([0, 1, 2]), signs=st.tuples(*[st.sampled_from([1, -1])] * 3), seed=st.integers(0, 2**32 - 1)
)
def test_collision_commutes_with_the_cubes_symmetries(name, model, order, signs, seed) -> None:
    lattice = lattice_named(name)
    g, acceleration = disturbed(lattice, np.random.default_rng(seed), cells=4)
    turned_velocities = lattice.velocities[:, order] * signs
    image = [int(np.flatnonzero((lattice.velocities == c).all(axis=1))[0]) for c in turned_velocities]

    def turn(populations: np.ndarray) -> np.ndarray:
        result = np.empty_like(populations)
        result[image] = populations
        return result

    turned_acceleration = acceleration[list(order)] * np.array(signs)[:, None]
    plain = collide(name, model, g, acceleration, tau=0.52, smagorinsky=0.1)[0]
    turned = collide(name, model, turn(g), turned_acceleration, tau=0.52, smagorinsky=0.1)[0]
    np.testing.assert_allclose(turned, turn(plain), atol=2e-7)


@pytest.mark.parametrize(("name", "model"), OFFERED[2:])
def test_regularised_populations_follow_from_ten_moments(name, model, rng) -> None:
    lattice = lattice_named(name)
    g, acceleration = disturbed(lattice, rng)
    c = lattice.velocities.astype(float)
    pairs = list(itertools.combinations_with_replacement(range(3), 2))
    ten = np.stack([np.ones(len(c)), *c.T, *(c[:, a] * c[:, b] for a, b in pairs)])
    ghost = np.linalg.svd(ten)[2][10:].T @ (0.01 * rng.standard_normal((len(c) - 10, g.shape[1])))
    plain = oracle.collide(lattice, model, g, acceleration, tau=0.6, smagorinsky=0.1)[0]
    haunted = oracle.collide(lattice, model, g + ghost, acceleration, tau=0.6, smagorinsky=0.1)[0]
    assert np.abs(ghost).max() > 0.01
    np.testing.assert_allclose(haunted, plain, atol=1e-14)


@every_model
def test_shear_relaxes_by_the_eddy_viscosity(name, model, rng) -> None:
    """tau_eff solves tau_eff = tau + 3 nu_t, nu_t = (Cs)^2 |S|, S = 3 stress / (2 rho tau_eff)."""
    lattice = lattice_named(name)
    g, still = disturbed(lattice, rng)[0], np.zeros((3, 64))
    tau, smagorinsky = 0.505, 0.12
    w = lattice.weights[:, None]
    density, _, stress = oracle.moments(lattice, g + w, still)
    after = oracle.moments(lattice, collide(name, model, g, still, tau=tau, smagorinsky=smagorinsky)[0] + w, still)[2]
    keep = after[0, 1] / stress[0, 1]
    tau_eff = 1.0 / (1.0 - keep)
    norm = np.sqrt((stress**2).sum(axis=(0, 1)))
    strain = np.sqrt(2.0) * 1.5 * norm / (density * tau_eff)  # |S| = sqrt(2 S:S)
    clear = np.abs(stress[0, 1]) > 1e-3
    assert clear.sum() > 20
    np.testing.assert_allclose(tau_eff[clear], (tau + 3.0 * smagorinsky**2 * strain)[clear], rtol=1e-3)


def test_third_order_needs_27_velocities() -> None:
    with pytest.raises(ValueError, match="'third_order' on D3Q19: it needs D3Q27"):
        collision.text(D3Q19, "third_order")
    assert "f26" in collision.text(D3Q27, "third_order")


def flow(name, model, shape_zyx, *, viscosity, device, smagorinsky=0.0, **faces) -> Flow:
    sides = {f"{a}_{side}": "periodic" for a in "xyz" for side in ("low", "high")} | faces
    config = FlowConfig(lattice=name, model=model, smagorinsky=smagorinsky, faces=Faces(**sides))
    return Flow(config, shape_zyx=shape_zyx, viscosity=viscosity, device=device)


def air(of: Flow) -> np.ndarray:
    """Velocity of the box [z, y, x, 3]."""
    of.update_velocity()
    return of.velocity.numpy()[1:-1, 1:-1, 1:-1].astype(np.float64)


@every_model
def test_shear_wave_decays_with_the_viscosity(name, model, device) -> None:
    """u_x = sin(k y) keeps exp(-nu k^2 t); carried across by v_y, to test Galilean invariance too."""
    n, nu = 32, 0.01
    k = 2.0 * np.pi / n
    wave = flow(name, model, (1, n, 1), viscosity=nu, device=device)
    u = np.zeros((1, n, 1, 3))
    u[..., 0] = 0.02 * np.sin(k * (np.arange(n) + 0.5))[:, None]
    u[..., 1] = 0.05
    wave.set_flow(velocity=u)

    def amplitude() -> float:
        return float(np.abs(np.fft.fft(air(wave)[0, :, 0, 0])[1]))

    wave.step(200)
    start = amplitude()
    wave.step(600)
    assert -np.log(amplitude() / start) / (600 * k**2) == pytest.approx(nu, rel=0.012 if model == "bgk" else 0.006)


@every_model
def test_body_force_drives_poiseuilles_parabola(name, model, device) -> None:
    n, nu, top = 16, 1 / 30, 0.02
    channel = flow(name, model, (1, n, 1), viscosity=nu, device=device, y_low="wall", y_high="wall")
    force = np.zeros(channel.force.shape, dtype=np.float32)
    force[0] = 8.0 * nu * top / n**2
    channel.force.assign(force)
    channel.step(8000)
    y = np.arange(n) + 0.5
    parabola = 4.0 * top * y * (n - y) / n**2
    error = air(channel)[0, :, 0, 0] - parabola
    assert np.sqrt((error**2).mean() / (parabola**2).mean()) < 0.01


@pytest.mark.parametrize(("name", "model"), OFFERED[2:])
def test_no_alternation_grows_below_a_sliding_lid(name, model, device) -> None:
    """The cavity at Re 1000: with the stress's trace relaxed at the rate of the shear it breaks up here."""
    n, speed = 32, 0.1
    sides = dict.fromkeys(("x_low", "x_high", "y_low"), "wall")
    lid = MovingWall(velocity=(speed, 0.0, 0.0))
    cavity = flow(name, model, (1, n, n), viscosity=speed * n / 1000, device=device, y_high=lid, **sides)
    cavity.step(6000)
    below_lid = air(cavity)[0, -1, 4:-4, 0] / speed
    assert 0.3 < below_lid.mean() < 0.9
    assert np.abs(below_lid[:-3] - 3.0 * below_lid[1:-2] + 3.0 * below_lid[2:-1] - below_lid[3:]).max() < 0.02
