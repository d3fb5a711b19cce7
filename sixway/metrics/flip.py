"""LDR-FLIP: the error that one notices when two images alternate (Andersson et al. 2020).

The package scores NaN as perfect, takes uint8 for [0, 255] unscaled and clips in silence. So its
inputs are checked here.
"""

from dataclasses import dataclass

import flip_evaluator
import numpy as np
from jaxtyping import Float

from sixway.metrics.images import check_pair

PIXELS_PER_DEGREE = 67.0
"""The viewer that every score here assumes: 0.7 m before a 0.7 m wide 4K monitor (FLIP's default)."""


@dataclass(frozen=True, kw_only=True)
class FlipScore:
    """mean: over the error map. error_map: [h, w] float32, 0 = no visible difference, up to 1."""

    mean: float
    error_map: Float[np.ndarray, "h w"]


def flip(*, predicted: Float[np.ndarray, "h w c"], reference: Float[np.ndarray, "h w c"]) -> FlipScore:
    """FLIP of two sRGB-encoded images in [0, 1], colour or grey (which is shown as equal red, green, blue).

    Raises ValueError unless both are float32, finite, within [0, 1], of one shape with 1 or 3 channels.
    """
    error, mean = _evaluate(predicted, reference, colours=False)
    return FlipScore(mean=mean, error_map=error[..., 0])


def flip_picture(
    *, predicted: Float[np.ndarray, "h w c"], reference: Float[np.ndarray, "h w c"]
) -> Float[np.ndarray, "h w 3"]:
    """The error map in FLIP's magma colours, sRGB-encoded [0, 1]: black = none, white = 1. Raises as `flip`."""
    return _evaluate(predicted, reference, colours=True)[0]


def _evaluate(predicted: np.ndarray, reference: np.ndarray, *, colours: bool) -> tuple[np.ndarray, float]:
    check_pair(predicted, reference)
    for name, image in (("predicted", predicted), ("reference", reference)):
        if image.dtype != np.float32:
            raise ValueError(f"{name} image has dtype {image.dtype}; FLIP needs float32 in [0, 1]")
        if image.shape[-1] not in (1, 3):
            raise ValueError(f"{name} image has {image.shape[-1]} channels; FLIP needs 3 (colour) or 1 (grey)")
        if image.min() < 0.0 or image.max() > 1.0:
            raise ValueError(
                f"{name} image spans [{image.min():g}, {image.max():g}]; FLIP needs [0, 1]: encode as sRGB and clip"
            )
    error, mean, _ = flip_evaluator.evaluate(
        _as_colour(reference),
        _as_colour(predicted),
        "LDR",
        inputsRGB=True,
        applyMagma=colours,
        parameters={"ppd": PIXELS_PER_DEGREE},
    )
    return error, float(mean)


def _as_colour(image: np.ndarray) -> np.ndarray:
    # a copy: the package refuses arrays that it may not write to
    return np.array(np.broadcast_to(image, (*image.shape[:2], 3)), order="C")
