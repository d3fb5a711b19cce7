"""Straight and premultiplied alpha: colours of thin smoke carried past its edge, and back."""

import numpy as np
from jaxtyping import Bool, Float

_LEAST_ALPHA = 1.0 / 255.0


def straight_colour(
    premultiplied: Float[np.ndarray, "h w c"], alpha: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w c"]:
    """Premultiplied values divided by alpha, float32; where alpha is below 1/255, the nearest carried outwards.

    Without these, filtering and mips would mix black into the rim.
    """
    known = alpha >= _LEAST_ALPHA
    divided = np.where(known[..., None], premultiplied / np.maximum(alpha, _LEAST_ALPHA)[..., None], 0.0)
    return dilated(divided.astype(np.float32), known)


def dilated(colour: Float[np.ndarray, "h w c"], known: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w c"]:
    """Fill what is not known from coarser and coarser averages of what is (pull and push)."""
    if known.all() or not known.any():
        return colour
    height, width = known.shape
    padded = ((0, height % 2), (0, width % 2))
    weight = np.pad(known.astype(np.float32), padded)
    sums = np.pad(colour * known[..., None], (*padded, (0, 0)))
    total = _halve(weight)
    coarse = _halve(sums) / np.maximum(total, 1e-12)[..., None]
    filled = dilated(coarse, total > 0.0)
    fine = filled.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    return np.where(known[..., None], colour, fine)


def _halve(array: np.ndarray) -> np.ndarray:
    return array[0::2, 0::2] + array[1::2, 0::2] + array[0::2, 1::2] + array[1::2, 1::2]
