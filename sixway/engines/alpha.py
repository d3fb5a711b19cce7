"""Premultiplied to straight alpha and back, with colours carried past the edge of the smoke."""

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS

_LEAST_ALPHA = 1.0 / 255.0


def _coloured(channels: tuple[str, ...]) -> list[int]:
    return [i for i, name in enumerate(channels) if name in DIRECTIONS]


def to_straight(image: Float[np.ndarray, "h w c"], channels: tuple[str, ...]) -> Float[np.ndarray, "h w c"]:
    """The six maps divided by alpha; where alpha is below 1/255, the nearest colours carried outwards.

    Without these, filtering and mips would mix black into the rim. Other channels stay. Raises ValueError
    where there is no alpha.
    """
    alpha = _alpha(image, channels)
    straight = image.copy()
    known = alpha >= _LEAST_ALPHA
    index = _coloured(channels)
    colour = np.where(known[..., None], image[..., index] / np.maximum(alpha, _LEAST_ALPHA)[..., None], 0.0)
    straight[..., index] = _dilate(colour.astype(np.float32), known)
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


def _dilate(colour: Float[np.ndarray, "h w c"], known: np.ndarray) -> Float[np.ndarray, "h w c"]:
    """Fill what is not known from coarser and coarser averages of what is (pull and push)."""
    if known.all() or not known.any():
        return colour
    height, width = known.shape
    padded = ((0, height % 2), (0, width % 2))
    weight = np.pad(known.astype(np.float32), padded)
    sums = np.pad(colour * known[..., None], (*padded, (0, 0)))
    total = _halve(weight)
    coarse = _halve(sums) / np.maximum(total, 1e-12)[..., None]
    filled = _dilate(coarse, total > 0.0)
    fine = filled.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    return np.where(known[..., None], colour, fine)


def _halve(array: np.ndarray) -> np.ndarray:
    return array[0::2, 0::2] + array[1::2, 0::2] + array[0::2, 1::2] + array[1::2, 1::2]
