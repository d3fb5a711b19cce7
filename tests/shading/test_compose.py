"""Shading against what each blend rule promises."""

import math

import numpy as np
import pytest

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS, TO_LIGHT
from sixway.core.records import SixWayLightmap
from sixway.shading.compose import over, shade
from sixway.shading.fire import ArtistRamp
from sixway.shading.light import DirectionalLight

RULES = ("squared", "paper_abs", "abs_normalised", "smoothstep")


def unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    length = math.hypot(*vector)
    return (vector[0] / length, vector[1] / length, vector[2] / length)


def lightmap(rng: np.random.Generator, *, emissive: bool = False) -> SixWayLightmap:
    channels = LIGHTMAP_CHANNELS if emissive else LIGHTMAP_CHANNELS[:-1]
    return SixWayLightmap(channels=channels, image=rng.random((5, 7, len(channels)), dtype=np.float32))


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("name", DIRECTIONS)
def test_a_light_on_an_axis_returns_that_map(rng, rule, name) -> None:
    maps = lightmap(rng)
    image = shade(maps, [DirectionalLight(to_light=TO_LIGHT[name])], rule=rule)
    for channel in range(3):
        np.testing.assert_allclose(image[..., channel], maps[name], rtol=1e-6)


def test_shading_is_linear_in_the_lights(rng) -> None:
    maps = lightmap(rng)
    red = DirectionalLight(to_light=unit((1, 2, -1)), colour=(1.0, 0.0, 0.0))
    blue = DirectionalLight(to_light=unit((-1, 0, 1)), colour=(0.0, 0.2, 0.9))
    together = shade(maps, [red, blue])
    np.testing.assert_allclose(together, shade(maps, [red]) + shade(maps, [blue]), rtol=1e-5, atol=1e-6)


def test_emissive_adds_its_colour_whatever_the_lights(rng) -> None:
    maps = lightmap(rng, emissive=True)
    ramp = ArtistRamp(stops=((1.0, (2.0, 1.0, 0.0)),))
    np.testing.assert_allclose(shade(maps, [], fire=ramp)[..., 0], 2.0 * maps["emissive"], rtol=1e-6)
    lit = shade(maps, [DirectionalLight(to_light=TO_LIGHT["top"])], fire=ramp)
    np.testing.assert_allclose(lit[..., 1], maps["top"] + maps["emissive"], rtol=1e-6)


def test_compositing_keeps_the_background_where_smoke_is_absent() -> None:
    background = np.full((2, 2, 3), 0.3, np.float32)
    alpha = np.array([[0.0, 1.0], [0.5, 0.25]], np.float32)
    image = over(np.zeros((2, 2, 3), np.float32), alpha, background)
    np.testing.assert_allclose(image[..., 0], 0.3 * (1 - alpha), rtol=1e-6)


def test_turning_carries_a_front_light_to_the_right() -> None:
    assert DirectionalLight.parse("front").turned(90.0).to_light == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
