"""Fire: bookkeeping of fuel, heat, soot and gas; the flame; the light that it gives."""

import math

import numpy as np
import pytest

from sixway.sim.carried import oracle
from sixway.sim.carried.burn import NEEDED, BurnConfig, Burner
from sixway.sim.carried.scalars import Scalars
from sixway.sim.flow.lattice import D3Q19

CONFIG = BurnConfig(most_expansion_per_step=0.1, hottest_k=700.0)


def bonfire(
    device: str, values: dict[str, np.ndarray], *, config: BurnConfig = CONFIG, refinement: int = 2, threads: int = 1
) -> tuple[Scalars, Burner]:
    shape = tuple(n // refinement for n in values["fuel"].shape)
    scalars = Scalars(NEEDED, shape_zyx=shape, refinement=refinement, device=device)
    for name in NEEDED:
        scalars.fields[name].assign(values.get(name, np.zeros(values["fuel"].shape)).astype(np.float32))
    return scalars, Burner(config, scalars, device=device, threads=threads)


@pytest.mark.parametrize("refinement", [1, 2, 4])
def test_kernels_equal_the_oracle(device: str, rng: np.random.Generator, refinement: int) -> None:
    shape = tuple(refinement * n for n in (3, 4, 5))
    values = {name: rng.random(shape) for name in NEEDED}
    values["temperature"] *= 600.0
    scalars, burner = bonfire(device, values, refinement=refinement)
    burner.burn(seconds=0.1, steps=4.0)
    *fields, growth = oracle.burn(
        *(values[name] for name in NEEDED),
        ignition=CONFIG.ignition_k,
        rate=CONFIG.burn_rate_per_s,
        heat=CONFIG.heat_k,
        hottest=CONFIG.hottest_k,
        soot=CONFIG.soot,
        expansion=CONFIG.expansion,
        most_growth=CONFIG.most_expansion_per_step,
        flame_life=CONFIG.flame_life_s,
        seconds=0.1,
        steps=4.0,
    )
    for name, expected in zip(NEEDED, fields, strict=True):
        np.testing.assert_allclose(scalars.fields[name].numpy(), expected, rtol=1e-5, atol=1e-6)
    source = np.pad(oracle.cell_means(growth, refinement), 1)
    np.testing.assert_allclose(burner.mass_source.numpy(), source, rtol=1e-5, atol=1e-8)
    assert fields[NEEDED.index("temperature")].max() == CONFIG.hottest_k > values["temperature"].max()  # capped
    assert 0.0 < growth[growth > 0.0].min() < CONFIG.most_expansion_per_step == growth.max()  # capped and not


def test_only_hot_fuel_burns(device: str) -> None:
    fuel = np.ones((4, 4, 4))
    temperature = np.full((4, 4, 4), CONFIG.ignition_k - 1.0)
    temperature[:2] = CONFIG.ignition_k
    scalars, burner = bonfire(device, {"fuel": fuel, "temperature": temperature})
    burner.burn(seconds=0.1, steps=4.0)
    after = {name: field.numpy() for name, field in scalars.fields.items()}
    np.testing.assert_array_equal(after["fuel"][2:], 1.0)
    np.testing.assert_array_equal(after["flame"], (temperature >= CONFIG.ignition_k).astype(float))
    np.testing.assert_array_equal(after["density"][2:], 0.0)
    assert after["fuel"][:2].max() < 1.0


def test_fuel_burns_exponentially_and_its_products_add_up(device: str) -> None:
    """Without expansion nothing is thinned, so what is lost in fuel is found as heat and soot."""
    config = BurnConfig(expansion=0.0)
    hot = {"fuel": np.full((2, 2, 2), 0.8), "temperature": np.full((2, 2, 2), 400.0)}
    scalars, burner = bonfire(device, hot, config=config)
    for _ in range(10):
        burner.burn(seconds=0.05, steps=4.0)
    fuel = scalars.fields["fuel"].numpy()
    burnt = 0.8 - fuel
    np.testing.assert_allclose(fuel, 0.8 * math.exp(-0.5 * config.burn_rate_per_s), rtol=1e-5)
    np.testing.assert_allclose(scalars.fields["temperature"].numpy(), 400.0 + config.heat_k * burnt, rtol=1e-5)
    np.testing.assert_allclose(scalars.fields["density"].numpy(), config.soot * burnt, rtol=1e-5)
    np.testing.assert_array_equal(burner.mass_source.numpy(), 0.0)


def test_the_flame_goes_out_after_its_life(device: str) -> None:
    """A unit of flame ages evenly (Nguyen et al. 2002, Eq. 10) and stays in 0..1."""
    values = {"fuel": np.zeros((2, 2, 2)), "flame": np.ones((2, 2, 2))}
    scalars, burner = bonfire(device, values)
    for step in range(1, 6):
        burner.burn(seconds=0.25 * CONFIG.flame_life_s, steps=4.0)
        np.testing.assert_allclose(scalars.fields["flame"].numpy(), max(0.0, 1.0 - 0.25 * step), atol=1e-6)


def test_growth_is_capped_and_thins_what_it_pushes_away(device: str) -> None:
    config = BurnConfig(expansion=20.0, soot=0.0, most_expansion_per_step=0.02)
    hot = {name: np.ones((2, 2, 2)) for name in NEEDED} | {"temperature": np.full((2, 2, 2), 400.0)}
    scalars, burner = bonfire(device, hot, config=config)
    burner.burn(seconds=0.1, steps=4.0)
    np.testing.assert_allclose(burner.mass_source.numpy()[1:-1, 1:-1, 1:-1], 0.02, rtol=1e-6)
    np.testing.assert_allclose(scalars.fields["density"].numpy(), math.exp(-4 * 0.02), rtol=1e-6)


def test_a_mass_source_with_the_winds_speed_does_not_brake_it() -> None:
    """What the flow has to add: mass s a step, momentum s u, stress s u u left to the collision."""
    u, s = np.array([0.08, -0.02, 0.01]), 0.02
    added = D3Q19.weights * s * (1.0 + 3.0 * D3Q19.velocities @ u)
    assert added.sum() == pytest.approx(s)
    np.testing.assert_allclose(added @ D3Q19.velocities, s * u, atol=1e-15)


def test_emission_is_that_of_a_black_body_in_the_flame(device: str) -> None:
    shape = (4, 4, 4)
    flame, temperature = np.zeros(shape), np.full(shape, CONFIG.hottest_k)
    flame[0], flame[1], flame[2] = 1.0, 0.5, 1.0
    temperature[2] = (CONFIG.hottest_k + CONFIG.ambient_k) / 2.0 - CONFIG.ambient_k  # half as hot, absolute
    values = {"fuel": np.zeros(shape), "flame": flame, "temperature": temperature}
    _, burner = bonfire(device, values)
    glow = burner.emission().numpy()
    for layer, part in enumerate((1.0, 0.5, 1.0 / 16.0, 0.0)):
        np.testing.assert_allclose(glow[layer], CONFIG.emission_per_m * part, rtol=1e-5)


def test_threads_change_no_byte(device: str, rng: np.random.Generator) -> None:
    values = {name: 600.0 * rng.random((36, 16, 16)) for name in NEEDED}
    after = []
    for threads in (1, 2):
        scalars, burner = bonfire(device, values, threads=threads)
        burner.burn(seconds=0.01, steps=4.0)
        arrays = (scalars.stacked, burner.mass_source, burner.emission())
        after.append(b"".join(array.numpy().tobytes() for array in arrays))
    assert after[0] == after[1]


def test_missing_fields_are_named(device: str) -> None:
    scalars = Scalars(("density", "fuel"), shape_zyx=(4, 4, 4), refinement=2, device=device)
    with pytest.raises(ValueError, match=r"without \['temperature', 'flame'\]"):
        Burner(CONFIG, scalars, device=device)
