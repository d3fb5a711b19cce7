"""Textures with premultiplied to straight alpha and back."""

import numpy as np
from jaxtyping import Float

from sixway.core.alpha import straight_colour
from sixway.core.conventions import DIRECTIONS


def _coloured(channels: tuple[str, ...]) -> list[int]:
    return [i for i, name in enumerate(channels) if name in DIRECTIONS]


def to_straight(image: Float[np.ndarray, "h w c"], channels: tuple[str, ...]) -> Float[np.ndarray, "h w c"]:
    """The six maps divided by alpha, their colours carried past the edge of the smoke (`core.alpha`).

    Other channels stay. Raises ValueError where there is no alpha.
    """
    alpha = _alpha(image, channels)
    straight = image.copy()
    index = _coloured(channels)
    straight[..., index] = straight_colour(image[..., index], alpha)
    return straight


def to_premultiplied(image: Float[np.ndarray, "h w c"], channels: tuple[str, ...]) -> Float[np.ndarray, "h w c"]:
    """The inverse of :func:`to_straight`, but for what lies outside the smoke: that becomes 0."""
    alpha = _alpha(image, channels)
    premultiplied = image.copy()
    index = _coloured(channels)
    premultiplied[..., index] = image[..., index] * alpha[..., None]
    return premultiplied


def _alpha(image: np.ndarray, channels: tuple[str, ...]) -> np.ndarray:
    if "alpha" not in channels:
        raise ValueError(f"straight alpha needs a channel 'alpha', the picture has {channels}")
    return image[..., channels.index("alpha")]
