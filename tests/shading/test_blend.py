"""Each blend rule against what it promises."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.shading.blend import blend_weights

RULES = ("squared", "paper_abs", "abs_normalised", "smoothstep")
components = st.floats(-1.0, 1.0, allow_nan=False)
vectors = st.tuples(components, components, components).filter(lambda v: math.hypot(*v) > 0.1)


@pytest.mark.parametrize("rule", RULES)
def test_a_light_on_an_axis_is_one_map(rule) -> None:
    axes = np.array([TO_LIGHT[name] for name in DIRECTIONS])
    np.testing.assert_allclose(blend_weights(axes, rule), np.eye(6), atol=1e-12)


@given(vectors)
def test_weights_sum_as_each_rule_says(vector) -> None:
    to_light = np.array(vector) / math.hypot(*vector)
    total = {rule: blend_weights(to_light, rule).sum() for rule in RULES}
    assert total["squared"] == pytest.approx(1.0)
    assert total["abs_normalised"] == pytest.approx(1.0)
    assert total["paper_abs"] == pytest.approx(np.abs(to_light).sum())
    assert 1.0 - 1e-9 <= total["smoothstep"] <= 1.85
    for rule in RULES:
        weights = blend_weights(to_light, rule)
        assert (weights >= 0.0).all() and np.count_nonzero(weights) <= 3


def test_the_printed_rule_over_lights_a_diagonal_by_73_percent() -> None:
    diagonal = np.ones(3) / math.sqrt(3.0)
    assert blend_weights(diagonal, "paper_abs").sum() == pytest.approx(math.sqrt(3.0))
    assert blend_weights(diagonal, "smoothstep").sum() == pytest.approx(3.0 - 2.0 / math.sqrt(3.0))


def test_pictures_of_directions_are_weighed_pixel_by_pixel(rng) -> None:
    to_light = rng.normal(size=(3, 4, 3))
    to_light /= np.linalg.norm(to_light, axis=-1, keepdims=True)
    for rule in RULES:
        weights = blend_weights(to_light, rule)
        assert weights.shape == (3, 4, 6)
        np.testing.assert_allclose(weights[1, 2], blend_weights(to_light[1, 2], rule))
