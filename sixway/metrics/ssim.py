"""Structural similarity as Wang et al. (2004) define it: Gaussian window of sigma 1.5 px, data range 1."""

import math

import numpy as np
from jaxtyping import Bool, Float
from skimage.metrics import structural_similarity

from sixway.metrics.images import check_mask, check_pair

_SIGMA_PX = 1.5
_WINDOW_PX = 11
_MARGIN_PX = _WINDOW_PX // 2


def ssim(
    *,
    predicted: Float[np.ndarray, "h w c"],
    reference: Float[np.ndarray, "h w c"],
    mask: Bool[np.ndarray, "h w"] | None = None,
) -> float:
    """Mean SSIM over pixels and channels, in float64; 1 for equal images.

    A margin of 5 px, where the window would leave the image, does not count. mask: the pixels to
    average over; NaN if none of them is inside the margin.
    Raises ValueError for images below 11 px, other shapes, NaN, or a mask that is not boolean.
    """
    check_pair(predicted, reference)
    if min(reference.shape[:2]) < _WINDOW_PX:
        raise ValueError(f"SSIM needs images of at least {_WINDOW_PX} x {_WINDOW_PX} px, got {reference.shape[:2]}")
    _, similarity = structural_similarity(
        reference.astype(np.float64),
        predicted.astype(np.float64),
        data_range=1.0,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=_SIGMA_PX,
        use_sample_covariance=False,
        full=True,
    )
    inner = (slice(_MARGIN_PX, -_MARGIN_PX), slice(_MARGIN_PX, -_MARGIN_PX))
    if mask is None:
        return float(similarity[inner].mean())
    check_mask(mask, reference)
    counted = similarity[inner][mask[inner]]
    return float(counted.mean()) if counted.size else math.nan
