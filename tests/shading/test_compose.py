"""Shading against what each blend rule promises."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS, TO_LIGHT
from sixway.core.records import SixWayLightmap
from sixway.shading.compose import blend_weights, over, shade
from sixway.shading.fire import ArtistRamp
from sixway.shading.light import DirectionalLight

RULES = ("squared", "paper_abs", "abs_normalised", "smoothstep")
components = st.floats(-1.0, 1.0, allow_nan=False)
vectors = st.tuples(components, components, components).filter(lambda v: math.hypot(*v) > 0.1)


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


@given(vectors)
def test_weights_sum_as_each_rule_says(vector) -> None:
    to_light = unit(vector)
    total = {rule: sum(blend_weights(to_light, rule).values()) for rule in RULES}
    assert total["squared"] == pytest.approx(1.0)
    assert total["abs_normalised"] == pytest.approx(1.0)
    assert total["paper_abs"] == pytest.approx(sum(map(abs, to_light)))
    assert 1.0 - 1e-9 <= total["smoothstep"] <= 1.85
    for rule in RULES:
        assert all(weight >= 0.0 for weight in blend_weights(to_light, rule).values())
        assert sum(weight > 0.0 for weight in blend_weights(to_light, rule).values()) <= 3


def test_the_printed_rule_over_lights_a_diagonal_by_73_percent() -> None:
    diagonal = unit((1.0, 1.0, 1.0))
    assert sum(blend_weights(diagonal, "paper_abs").values()) == pytest.approx(math.sqrt(3.0))


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


@pytest.mark.parametrize(
    ("text", "to_light", "colour"),
    [
        ("right", (1, 0, 0), (1, 1, 1)),
        ("right,1,0.9,0.8", (1, 0, 0), (1, 0.9, 0.8)),
        ("0:0:2,3,3,3", (0, 0, 1), (3, 3, 3)),
    ],
)
def test_lights_as_a_user_writes_them(text, to_light, colour) -> None:
    light = DirectionalLight.parse(text)
    assert light.to_light == pytest.approx(to_light)
    assert light.colour == pytest.approx(colour)


@pytest.mark.parametrize("text", ["sideways", "right,1", "0:0:0", "1:2,1,1,1", "right,a,b,c", "right,-1,0,0"])
def test_lights_that_make_no_sense_are_refused(text) -> None:
    with pytest.raises(ValueError, match="light"):
        DirectionalLight.parse(text)


def test_turning_carries_a_front_light_to_the_right() -> None:
    assert DirectionalLight.parse("front").turned(90.0).to_light == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
