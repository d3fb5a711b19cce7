"""The fields that air carries: sources, fading, cooling, checkpoints, refusals."""

import math

import numpy as np
import pytest
import warp as wp

from sixway.sim.carried import oracle
from sixway.sim.carried.scalars import Scalars, Scheme


def still(device: str, shape: tuple[int, int, int] = (6, 6, 6)) -> wp.array:
    return wp.zeros(shape, dtype=wp.vec3, device=device)


def filled(device: str, values: np.ndarray, names: tuple[str, ...] = ("density",), **options: object) -> Scalars:
    shape = tuple(n // 2 for n in values.shape)
    scalars = Scalars(names, shape_zyx=shape, refinement=2, device=device, **options)
    for name in names:
        scalars.fields[name].assign(values.astype(np.float32))
    return scalars


@pytest.mark.parametrize("scheme", ["cubic", "linear"])
def test_still_air_keeps_everything(device: str, rng: np.random.Generator, scheme: Scheme) -> None:
    values = rng.random((8, 8, 8)).astype(np.float32)
    scalars = filled(device, values, scheme=scheme)
    scalars.advect(still(device), steps=4.0)
    np.testing.assert_array_equal(scalars.fields["density"].numpy(), values)


def test_sources_raise_and_never_lower_nor_fill_obstacles(device: str, rng: np.random.Generator) -> None:
    values, source = rng.random((2, 8, 8, 8)).astype(np.float32)
    solid = rng.random((8, 8, 8)) > 0.8
    scalars = filled(device, np.where(solid, 0.0, values), ("density", "fuel"))
    fraction = wp.array(solid, dtype=wp.float32, device=device)
    scalars.advect(still(device), steps=1.0, solid_fraction=fraction)
    scalars.feed("density", wp.array(source, dtype=wp.float32, device=device))
    expected = np.where(solid, 0.0, np.maximum(values, source))
    np.testing.assert_array_equal(scalars.fields["density"].numpy(), expected)
    np.testing.assert_array_equal(scalars.fields["fuel"].numpy(), np.where(solid, 0.0, values))


def test_dissipation_is_exponential_whatever_the_step(device: str, rng: np.random.Generator) -> None:
    values = rng.random((8, 8, 8))
    once, often = filled(device, values), filled(device, values)
    once.dissipate("density", rate_per_s=0.7, seconds=2.0)
    for _ in range(20):
        often.dissipate("density", rate_per_s=0.7, seconds=0.1)
    np.testing.assert_allclose(once.fields["density"].numpy(), values * math.exp(-1.4), rtol=1e-6)
    np.testing.assert_allclose(often.fields["density"].numpy(), once.fields["density"].numpy(), rtol=1e-5)


@pytest.mark.parametrize("rate, radiation", [(0.7, 0.0), (0.0, 4000.0), (0.3, 900.0)])
def test_cooling_solves_its_equation(device: str, rng: np.random.Generator, rate: float, radiation: float) -> None:
    values = rng.uniform(-50.0, 2000.0, (8, 8, 8))
    law = {"rate_per_s": rate, "radiation_k_per_s": radiation, "hottest_k": 1500.0, "seconds": 0.5}
    scalars = filled(device, values)
    scalars.cool("density", **law)
    expected = oracle.cool(values, **law)
    np.testing.assert_allclose(scalars.fields["density"].numpy(), expected, rtol=2e-4, atol=1e-3)


def test_values_under_the_floor_become_zero(device: str) -> None:
    values = np.full((8, 8, 8), 1e-7)
    values[4] = -0.5
    scalars = filled(device, values)
    scalars.advect(still(device), steps=1.0)
    np.testing.assert_array_equal(scalars.fields["density"].numpy(), np.where(values < 0, -0.5, 0.0))


@pytest.mark.parametrize("scheme", ["cubic", "linear"])
def test_a_checkpoint_goes_on_bit_for_bit(device: str, rng: np.random.Generator, scheme: Scheme) -> None:
    """Also with an obstacle that moves: where it stood is part of the state."""
    wind = wp.array(rng.uniform(-0.3, 0.3, (6, 6, 6, 3)), dtype=wp.vec3, device=device)
    balls = [wp.array(rng.random((8, 8, 8)) > 0.8, dtype=wp.float32, device=device) for _ in range(4)]
    first = filled(device, rng.random((8, 8, 8)), ("density", "temperature"), scheme=scheme)
    for ball in balls[:2]:
        first.advect(wind, steps=4.0, solid_fraction=ball)
    state = first.state()
    second = filled(device, rng.random((8, 8, 8)), ("density", "temperature"), scheme=scheme)
    second.restore(state)
    for ball in balls[2:]:
        first.advect(wind, steps=4.0, solid_fraction=ball)
        second.advect(wind, steps=4.0, solid_fraction=ball)
    assert first.stacked.numpy().tobytes() == second.stacked.numpy().tobytes()
    assert first.state()["scalar.density"].tobytes() != state["scalar.density"].tobytes()


def test_mass_is_the_sum_of_the_voxels(device: str, rng: np.random.Generator) -> None:
    values = rng.random((8, 8, 8))
    assert filled(device, values).mass()["density"] == pytest.approx(values.sum(), rel=1e-6)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"refinement": 3}, "refinement 3 must be 1, 2 or 4"),
        ({"scheme": "upwind"}, "scheme 'upwind' is not known"),
        ({"names": ("a", "a")}, "different names"),
        ({"names": ()}, "1 to 30"),
        ({"floor": -1.0}, "floor -1.0"),
        ({"faces": {"top": "open"}}, "'top'"),
        ({"faces": {"x_low": "leaky"}}, "'leaky'"),
        ({"faces": {"x_low": "periodic"}}, "make both periodic"),
    ],
)
def test_refusals(device: str, change: dict, message: str) -> None:
    options = {"names": ("a",), "shape_zyx": (4, 4, 4), "refinement": 2, "device": device, **change}
    with pytest.raises(ValueError, match=message):
        Scalars(options.pop("names"), **options)


def test_shapes_that_do_not_fit_are_refused(device: str) -> None:
    scalars = filled(device, np.zeros((8, 8, 8)))
    with pytest.raises(ValueError, match="velocity of shape"):
        scalars.advect(still(device, (4, 4, 4)), steps=1.0)
    with pytest.raises(ValueError, match="solid_fraction of shape"):
        fraction = wp.zeros((4, 4, 4), dtype=wp.float32, device=device)
        scalars.advect(still(device), steps=1.0, solid_fraction=fraction)
    with pytest.raises(ValueError, match="got nothing"):
        scalars.restore({"scalar_solid": np.zeros((8, 8, 8), np.uint8)})
    with pytest.raises(ValueError, match="same scenario"):
        scalars.restore({"scalar.density": np.zeros((4, 4, 4), np.float32), "scalar_solid": np.zeros(1, np.uint8)})
    with pytest.raises(ValueError, match="would make density grow"):
        scalars.dissipate("density", rate_per_s=-1.0, seconds=1.0)
    with pytest.raises(ValueError, match="would heat"):
        scalars.cool("density", rate_per_s=-1.0, seconds=1.0)
