"""Flicker: what changes between two frames beyond the motion of the smoke (as in Lai et al. 2018)."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import map_coordinates

from sixway.metrics.images import check_mask, check_pair


@dataclass(frozen=True, kw_only=True)
class TemporalError:
    """mean_abs: mean |P_t - warp(P_{t-1})| over the pixels that count, NaN if none do. coverage: their share."""

    mean_abs: float
    coverage: float


def warp_previous(
    previous: Float[np.ndarray, "h w c"], flow: Float[np.ndarray, "h w 2"]
) -> tuple[Float[np.ndarray, "h w c"], Bool[np.ndarray, "h w"]]:
    """What the previous frame says about the pixels of this one, bilinear, float64; and where it says anything.

    flow: [px/frame; right, down] from t - 1 to t, standing on the pixels of frame t: what is seen at x
    was at x - flow(x). Pixels whose source lies outside the previous frame are marked False.
    """
    height, width = flow.shape[:2]
    rows, columns = np.mgrid[0:height, 0:width]
    source = np.stack([rows - flow[..., 1], columns - flow[..., 0]]).astype(np.float64)
    known = (source[0] >= 0.0) & (source[0] <= height - 1.0) & (source[1] >= 0.0) & (source[1] <= width - 1.0)
    values = previous.astype(np.float64)
    warped = [
        map_coordinates(values[..., channel], source, order=1, mode="nearest") for channel in range(values.shape[-1])
    ]
    return np.stack(warped, axis=-1), known


def temporal_error(
    *,
    current: Float[np.ndarray, "h w c"],
    previous: Float[np.ndarray, "h w c"],
    flow: Float[np.ndarray, "h w 2"],
    mask: Bool[np.ndarray, "h w"] | None = None,
) -> TemporalError:
    """Flow-warped difference of two consecutive frames; flow as in `warp_previous`, mask on frame t.

    Smoke that turns or thins changes its light as well, so even a perfect prediction scores above 0:
    compare with the score of the reference under the same flow.
    Raises ValueError for other shapes, NaN, or a mask that is not boolean.
    """
    check_pair(current, previous)
    if flow.shape != (*current.shape[:2], 2):
        raise ValueError(f"flow has shape {flow.shape}, expected {(*current.shape[:2], 2)}")
    if not np.isfinite(flow).all():
        raise ValueError("flow holds NaN or infinite values; mask them and set them to 0")
    warped, counted = warp_previous(previous, flow)
    if mask is not None:
        check_mask(mask, current)
        counted = counted & mask
    difference = np.abs(current.astype(np.float64) - warped)[counted]
    return TemporalError(
        mean_abs=float(difference.mean()) if difference.size else math.nan, coverage=float(counted.mean())
    )
