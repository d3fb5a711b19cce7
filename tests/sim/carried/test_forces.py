"""Buoyancy and vorticity confinement."""

import numpy as np
import pytest
import warp as wp

from sixway.sim.carried import oracle
from sixway.sim.carried.forces import Forces
from sixway.sim.carried.scalars import Scalars


def pushed(
    device: str,
    velocity: np.ndarray,
    fields: dict[str, np.ndarray],
    *,
    lifts: dict[str, float],
    confinement: float = 0.0,
    refinement: int = 2,
    threads: int = 1,
) -> np.ndarray:
    shape = tuple(n - 2 for n in velocity.shape[:3])
    scalars = Scalars(tuple(fields), shape_zyx=shape, refinement=refinement, device=device)
    for name, values in fields.items():
        scalars.fields[name].assign(values.astype(np.float32))
    forces = Forces(scalars, lifts=lifts, confinement=confinement, device=device, threads=threads)
    force = wp.zeros((3, *velocity.shape[:3]), dtype=wp.float32, device=device)
    forces.update(wp.array(velocity, dtype=wp.vec3, device=device), force)
    return force.numpy()


@pytest.mark.parametrize("refinement", [1, 2, 4])
@pytest.mark.parametrize("confinement", [0.0, 0.02])
def test_kernels_equal_the_oracle(device: str, rng: np.random.Generator, refinement: int, confinement: float) -> None:
    velocity = rng.uniform(-0.1, 0.1, (6, 7, 8, 3))
    shape = tuple(refinement * (n - 2) for n in velocity.shape[:3])
    fields = {"density": rng.random(shape), "heat": rng.random(shape), "fuel": rng.random(shape)}
    lifts = {"density": -0.01, "heat": 0.03}
    force = pushed(device, velocity, fields, lifts=lifts, confinement=confinement, refinement=refinement)
    stacked = np.stack(list(fields.values()))
    expected = oracle.push(velocity, stacked, confinement=confinement, lifts=(-0.01, 0.03, 0.0), refinement=refinement)
    np.testing.assert_allclose(force[:, 1:-1, 1:-1, 1:-1], expected, atol=1e-7)
    shell = np.ones(force.shape[1:], bool)
    shell[1:-1, 1:-1, 1:-1] = False
    np.testing.assert_array_equal(force[:, shell], 0.0)


def test_heavy_smoke_sinks_and_heat_lifts(device: str) -> None:
    fields = {"density": np.full((8, 8, 8), 2.0), "heat": np.full((8, 8, 8), 30.0)}
    velocity = np.zeros((6, 6, 6, 3))
    force = pushed(device, velocity, fields, lifts={"density": -0.01, "heat": 0.002})
    np.testing.assert_allclose(force[1, 1:-1, 1:-1, 1:-1], -0.02 + 0.06, rtol=1e-6)
    np.testing.assert_array_equal(force[[0, 2]], 0.0)


def test_rigid_rotation_and_still_air_have_nothing_to_confine(device: str) -> None:
    """Even vorticity has no gradient, so confinement has no direction; float noise must not invent one."""
    _, y, x = np.indices((10, 10, 10)) - 4.5
    turning = 0.0625 * np.stack([-y, x, np.zeros_like(x)], axis=-1)
    for velocity in (turning, np.zeros_like(turning)):
        force = pushed(device, velocity, {"smoke": np.zeros((16, 16, 16))}, lifts={}, confinement=0.1)
        np.testing.assert_array_equal(force, 0.0)


def test_confinement_speeds_a_vortex_up(device: str) -> None:
    """N points to the vortex's core, so N x omega points along its swirl; twice the wind, twice the force."""
    z, y, x = np.indices((18, 18, 18)) - 8.5
    r2 = x**2 + y**2
    swirl = 0.05 * np.exp(-r2 / 18.0)[..., None] * np.stack([-y, x, np.zeros_like(x)], axis=-1)
    force = pushed(device, swirl, {"smoke": np.zeros((32, 32, 32))}, lifts={}, confinement=0.05)
    ring = (r2 > 2.0) & (r2 < 16.0)
    along = (force[0] * -y + force[1] * x)[ring] / np.sqrt(r2[ring])
    inner = along[np.broadcast_to(np.abs(z) < 8, ring.shape)[ring]]
    assert inner.min() > 0.0
    twice = pushed(device, 2 * swirl, {"smoke": np.zeros((32, 32, 32))}, lifts={}, confinement=0.05)
    np.testing.assert_allclose(twice, 2.0 * force, atol=1e-7)


def test_threads_change_no_byte(device: str, rng: np.random.Generator) -> None:
    velocity = rng.uniform(-0.1, 0.1, (20, 12, 12, 3))
    fields = {"density": rng.random((36, 20, 20))}
    one, two = (
        pushed(device, velocity, fields, lifts={"density": 0.1}, confinement=0.1, threads=threads) for threads in (1, 2)
    )
    assert one.tobytes() == two.tobytes()


def test_refusals(device: str) -> None:
    scalars = Scalars(("smoke",), shape_zyx=(4, 4, 4), refinement=2, device=device)
    with pytest.raises(ValueError, match=r"lifts name \['heat'\]"):
        Forces(scalars, lifts={"heat": 1.0}, confinement=0.0, device=device)
    with pytest.raises(ValueError, match="confinement -1.0"):
        Forces(scalars, lifts={}, confinement=-1.0, device=device)
    forces = Forces(scalars, lifts={}, confinement=0.0, device=device)
    with pytest.raises(ValueError, match="with their shell"):
        small = wp.zeros((4, 4, 4), dtype=wp.vec3, device=device)
        forces.update(small, wp.zeros((3, 6, 6, 6), dtype=wp.float32, device=device))
