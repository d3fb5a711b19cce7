"""Smoke among solids against the closed form of an even slab."""

import math

import numpy as np
import pytest

from sixway.shading.scene import composed, cut_off, part_in_front

DEPTH = np.full((1, 5), 2.0)


def slab(optical_depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Colour and alpha of even smoke that glows, 1 m thick: L = q (1 - exp(-tau))."""
    alpha = np.full((1, 5), 1.0 - math.exp(-optical_depth))
    return np.stack([3.0 * alpha, 2.0 * alpha, alpha], axis=-1), alpha


def test_a_wall_in_front_hides_and_one_behind_does_not() -> None:
    colour, alpha = slab(1.3)
    wall = np.array([[1.0, 2.0, 3.0, 4.0, np.inf]])
    background = np.full((1, 5, 3), 0.25)
    image = composed(colour, alpha, DEPTH, background, wall, thickness_m=1.0)
    np.testing.assert_allclose(image[0, :2], 0.25)
    np.testing.assert_allclose(image[0, 2:], (colour + (1.0 - alpha[..., None]) * 0.25)[0, 2:])


@pytest.mark.parametrize("optical_depth", [0.01, 1.0, 6.0])
def test_a_wall_inside_keeps_what_the_smoke_before_it_shows(optical_depth: float) -> None:
    """Smoke of 1 m, a wall 0.25 m behind its beginning: a quarter of the optical depth."""
    colour, alpha = slab(optical_depth)
    kept, kept_alpha = cut_off(colour, alpha, part_in_front(DEPTH, np.full((1, 5), 2.25), 1.0))
    expected = 1.0 - math.exp(-0.25 * optical_depth)
    np.testing.assert_allclose(kept_alpha, expected, rtol=1e-6)
    np.testing.assert_allclose(kept[..., 0], 3.0 * expected, rtol=1e-6)


def test_opaque_smoke_hides_a_wall_that_it_reaches() -> None:
    kept = cut_off(np.ones((1, 1, 3)), np.ones((1, 1)), np.array([[0.1]]))
    np.testing.assert_allclose(kept[1], 1.0)
    gone = cut_off(np.ones((1, 1, 3)), np.ones((1, 1)), np.array([[0.0]]))
    assert not gone[0].any() and not gone[1].any()


def test_it_fades_without_a_step_and_only_more(rng) -> None:
    colour, alpha = slab(2.0)
    walls = np.linspace(1.9, 3.1, 50)
    alphas = [cut_off(colour, alpha, part_in_front(DEPTH, np.full((1, 5), wall), 1.0))[1][0, 0] for wall in walls]
    assert (np.diff(alphas) >= 0.0).all() and np.diff(alphas).max() < 0.06


def test_where_the_depth_knows_no_smoke_any_wall_hides_what_the_net_left_there() -> None:
    part = part_in_front(np.array([[np.inf, np.inf]]), np.array([[5.0, np.inf]]), 0.5)
    np.testing.assert_array_equal(part, [[0.0, 1.0]])


def test_a_thickness_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="thickness_m must be positive"):
        part_in_front(DEPTH, DEPTH, 0.0)
