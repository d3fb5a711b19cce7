"""Colour of the smoke against Unity's formula worked by hand."""

import math

import numpy as np
import pytest

from sixway.shading.colour import WHITE, SmokeColour, coloured

LIGHT = np.array([[0.0, 0.05, 0.3], [0.7, 1.0, 0.0]])
OPAQUE = np.ones_like(LIGHT)


def absorbing(red: float, strength: float) -> SmokeColour:
    return SmokeColour(rgb=(red, 1.0, 0.2), mode="absorption", strength=strength)


def test_multiplying_is_multiplying() -> None:
    np.testing.assert_allclose(coloured(LIGHT, OPAQUE, SmokeColour(rgb=(2.0, 0.5, 0.0)))[..., 1], 0.5 * LIGHT)
    np.testing.assert_allclose(coloured(LIGHT, OPAQUE, WHITE), np.stack([LIGHT] * 3, axis=-1))


@pytest.mark.parametrize("strength", [0.0, 0.3, 1.0, 2.0])
def test_white_absorbs_nothing_and_a_fifth_squares(strength: float) -> None:
    dyed = coloured(LIGHT, OPAQUE, absorbing(1.0, strength))
    np.testing.assert_allclose(dyed[..., 0], LIGHT, atol=1e-12)  # k = 1
    full = 1.0 + min(strength, 1.0) * (math.pi - 1.0)
    np.testing.assert_allclose(dyed[..., 2], LIGHT**2 / full, atol=1e-12)  # k = 2


@pytest.mark.parametrize(("red", "strength"), [(0.5, 0.4), (0.05, 0.0), (0.9, 1.0), (0.0, 0.7)])
def test_absorption_is_the_engines_formula(red: float, strength: float) -> None:
    """pi * G(t / pi), G(s) = r * saturate(s / r)^k, as the engine writes it."""
    k = 1.0 + math.log2(max(red, 1e-5)) / math.log2(0.2)
    r = 1.0 / math.pi + strength * (1.0 - 1.0 / math.pi)
    expected = math.pi * r * np.clip(LIGHT / math.pi / r, 0.0, 1.0) ** k
    np.testing.assert_allclose(coloured(LIGHT, OPAQUE, absorbing(red, strength))[..., 0], expected, rtol=1e-12)


def test_premultiplied_light_is_dyed_as_straight_light_is() -> None:
    alpha = np.array([[0.0, 0.1, 0.5], [1.0, 0.25, 0.0]])
    straight = np.array([[0.0, 0.3, 0.6], [0.7, 1.0, 0.0]])
    colour = absorbing(0.4, 0.5)
    expected = coloured(straight, np.ones_like(alpha), colour) * alpha[..., None]
    np.testing.assert_allclose(coloured(straight * alpha, alpha, colour), expected, atol=1e-12)


def test_dark_parts_lose_more_of_what_the_colour_lacks() -> None:
    dyed = coloured(np.array([0.9, 0.1]), np.ones(2), absorbing(0.5, 0.0))
    assert dyed[1, 0] / 0.1 < 0.6 * dyed[0, 0] / 0.9


@pytest.mark.parametrize("rgb", [(-1.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (2.0, 1.0, 1.0)])
def test_impossible_colours_are_refused(rgb) -> None:
    with pytest.raises(ValueError, match="smoke colour"):
        SmokeColour(rgb=rgb, mode="absorption")
