"""Straight colours: exact inside the smoke, carried outwards past its edge."""

import numpy as np

from sixway.core.alpha import dilated, straight_colour


def test_inside_the_smoke_straight_is_divided_by_alpha(rng) -> None:
    colour, alpha = rng.random((9, 7, 3), dtype=np.float32), rng.uniform(0.1, 1.0, (9, 7)).astype(np.float32)
    np.testing.assert_allclose(straight_colour(colour * alpha[..., None], alpha), colour, rtol=1e-5)


def test_outside_the_smoke_its_colour_goes_on() -> None:
    alpha = np.zeros((16, 16), np.float32)
    alpha[4:9, 5:8] = 0.5
    straight = straight_colour(np.stack([0.4 * alpha, 0.2 * alpha], axis=-1), alpha)
    np.testing.assert_allclose(straight, np.broadcast_to([0.4, 0.2], (16, 16, 2)), rtol=1e-6)


def test_what_is_filled_lies_between_what_is_known(rng) -> None:
    known = rng.random((13, 11)) > 0.9
    colour = rng.uniform(0.2, 0.7, (13, 11, 1)).astype(np.float32)
    filled = dilated(colour, known)
    np.testing.assert_array_equal(filled[known], colour[known])
    assert filled.min() >= colour[known].min() - 1e-6 and filled.max() <= colour[known].max() + 1e-6
    nothing = np.zeros_like(known)
    np.testing.assert_array_equal(dilated(colour, nothing), colour)
