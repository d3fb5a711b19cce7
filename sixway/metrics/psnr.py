"""Squared error and PSNR, per frame and over many frames. Data range 1, always.

Two averages are usual and differ by decibels: the mean of the frames' PSNR (most papers' tables;
easy frames pull it up) and the PSNR of the mean squared error. A summary gives both.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from sixway.metrics.images import check_mask, check_pair


@dataclass(frozen=True, kw_only=True)
class FrameError:
    """mse: mean squared error over the pixels that count, NaN if none do. coverage: their share, [0, 1]."""

    mse: float
    coverage: float

    @property
    def psnr_db(self) -> float:
        return psnr_of_mse(self.mse)


@dataclass(frozen=True, kw_only=True)
class PsnrSummary:
    """PSNR [dB] over frames. Both averages are infinite if every frame is perfect, NaN if every one is empty.

    mean_of_psnr_db: mean over the frames whose PSNR is finite. psnr_of_mean_mse_db: from the mean MSE
    of all frames but the empty ones. lowest_db, highest_db: over all but the empty ones. frames: all
    of them; perfect: with no error at all (infinite PSNR); empty: masked as a whole.
    mean_coverage: over all frames.
    """

    mean_of_psnr_db: float
    psnr_of_mean_mse_db: float
    lowest_db: float
    highest_db: float
    frames: int
    perfect: int
    empty: int
    mean_coverage: float


def mse(
    *,
    predicted: Float[np.ndarray, "h w c"],
    reference: Float[np.ndarray, "h w c"],
    mask: Bool[np.ndarray, "h w"] | None = None,
) -> FrameError:
    """Mean squared error over pixels and channels, in float64; with a mask, over the pixels that it names.

    Raises ValueError for other shapes, NaN, or a mask that is not boolean.
    """
    check_pair(predicted, reference)
    squared = (predicted.astype(np.float64) - reference.astype(np.float64)) ** 2
    if mask is None:
        return FrameError(mse=float(squared.mean()), coverage=1.0)
    check_mask(mask, reference)
    inside = squared[mask]
    return FrameError(mse=float(inside.mean()) if inside.size else math.nan, coverage=float(mask.mean()))


def psnr(
    *,
    predicted: Float[np.ndarray, "h w c"],
    reference: Float[np.ndarray, "h w c"],
    mask: Bool[np.ndarray, "h w"] | None = None,
) -> float:
    """Peak signal-to-noise ratio [dB] for a peak of 1; infinite for equal images, NaN for an empty mask."""
    return mse(predicted=predicted, reference=reference, mask=mask).psnr_db


def psnr_of_mse(mean_squared_error: float) -> float:
    """-10 log10(MSE) [dB]: a peak of 1."""
    return math.inf if mean_squared_error == 0.0 else -10.0 * math.log10(mean_squared_error)


def summarise_psnr(errors: Sequence[FrameError]) -> PsnrSummary:
    """Both averages over the frames, with the frames counted that an average cannot hold.

    Raises ValueError for no frames at all.
    """
    if not errors:
        raise ValueError("a summary needs at least one frame")
    seen = [error for error in errors if error.coverage > 0.0]
    decibels = [error.psnr_db for error in seen]
    finite = [value for value in decibels if math.isfinite(value)]
    nothing = math.inf if seen else math.nan
    return PsnrSummary(
        mean_of_psnr_db=math.fsum(finite) / len(finite) if finite else nothing,
        psnr_of_mean_mse_db=psnr_of_mse(math.fsum(error.mse for error in seen) / len(seen)) if seen else math.nan,
        lowest_db=min(decibels, default=math.nan),
        highest_db=max(decibels, default=math.nan),
        frames=len(errors),
        perfect=len(decibels) - len(finite),
        empty=len(errors) - len(seen),
        mean_coverage=math.fsum(error.coverage for error in errors) / len(errors),
    )
