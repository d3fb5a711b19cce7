"""Advection of density."""

import numpy as np
import pytest
import warp as wp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sixway.sim import kernels, oracle


def advect(
    device: str,
    velocity: np.ndarray,
    source: np.ndarray,
    obstacle: np.ndarray,
    smoke: np.ndarray,
    *,
    refinement: int = 2,
    steps: int = 4,
    cubic: bool = True,
) -> np.ndarray:
    def put(values: np.ndarray, dtype: type = wp.float32) -> wp.array:
        return wp.array(values, dtype=dtype, device=device)

    after = put(np.zeros(smoke.shape))
    fields = [put(velocity, wp.vec3), put(source), put(obstacle)]
    inputs = [*fields, float(refinement), float(steps), cubic, put(smoke), after]
    wp.launch(kernels.advect, dim=smoke.shape, inputs=inputs, device=device)
    return after.numpy()


@pytest.mark.parametrize("refinement", [1, 2])
@pytest.mark.parametrize("cubic", [True, False])
def test_kernel_equals_oracle(device: str, rng: np.random.Generator, cubic: bool, refinement: int) -> None:
    shape = tuple(refinement * n for n in (5, 6, 7))
    velocity = rng.uniform(-0.3, 0.3, (7, 8, 9, 3))
    smoke = rng.random(shape) * (rng.random(shape) > 0.3)
    source = np.where(rng.random(shape) > 0.95, 1.0, 0.0)
    obstacle = np.where(rng.random(shape) > 0.95, rng.random(shape), 0.0)
    fields = (velocity, source, obstacle, smoke)
    actual = advect(device, *fields, refinement=refinement, cubic=cubic)
    expected = oracle.advect(*fields, refinement=refinement, steps=4, cubic=cubic)
    np.testing.assert_allclose(actual, expected, atol=2e-5)


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0.0, 0.5), cubic=st.booleans())
def test_smoke_never_leaves_its_bounds(device: str, seed: int, speed: float, cubic: bool) -> None:
    rng = np.random.default_rng(seed)
    smoke = rng.random((8, 8, 8))
    velocity = rng.uniform(-speed, speed, (6, 6, 6, 3))
    nothing = np.zeros(smoke.shape)
    after = advect(device, velocity, nothing, nothing, smoke, cubic=cubic)
    assert after.min() >= 0.0
    assert after.max() <= np.float32(smoke.max())


def test_an_even_wind_moves_smoke_by_whole_voxels_exactly(device: str, rng: np.random.Generator) -> None:
    smoke = rng.random((8, 8, 8)).astype(np.float32)
    velocity = np.broadcast_to(np.array([0.25, 0.0, 0.0]), (6, 6, 6, 3))
    nothing = np.zeros(smoke.shape)
    after = advect(device, velocity, nothing, nothing, smoke)  # 0.25 cells/step, 4 steps, 2 voxels a cell
    np.testing.assert_allclose(after[:, :, 2:], smoke[:, :, :-2], atol=1e-6)


def test_wind_from_above_brings_clear_air(device: str) -> None:
    smoke = np.ones((8, 8, 8))
    velocity = np.broadcast_to(np.array([0.0, -0.25, 0.0]), (6, 6, 6, 3))
    nothing = np.zeros(smoke.shape)
    after = advect(device, velocity, nothing, nothing, smoke)
    np.testing.assert_array_equal(after[:, -2:], 0.0)
    np.testing.assert_array_equal(after[:, :-2], 1.0)


@pytest.mark.parametrize("refinement", [1, 3])
def test_buoyancy_is_the_mean_density_of_a_cell(device: str, rng: np.random.Generator, refinement: int) -> None:
    smoke = rng.random((2 * refinement, 3 * refinement, 4 * refinement))
    lift = wp.zeros((4, 5, 6), dtype=wp.float32, device=device)
    inputs = [wp.array(smoke, dtype=wp.float32, device=device), refinement, 1e-3, lift]
    wp.launch(kernels.buoyancy, dim=(2, 3, 4), inputs=inputs, device=device)
    expected = np.pad(oracle.buoyancy(smoke, refinement=refinement, strength=1e-3), 1)
    np.testing.assert_allclose(lift.numpy(), expected, atol=1e-9)
