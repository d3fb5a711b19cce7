"""How dense is a stranger's density? Files run from maxima of 1 to 50; the eye wants one optical depth."""

import numpy as np

from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError

DEFAULT_OPTICAL_DEPTH = 8.0


def extinction_for_optical_depth(
    frame: DensityFrame, *, optical_depth: float = DEFAULT_OPTICAL_DEPTH, percentile: float = 99.0
) -> float:
    """Extinction per density [1/m] that gives the frame's thick columns that optical depth.

    Columns run along x, y and z; the percentile is taken over those that hold smoke. Raises VolumeError
    for an empty frame.
    """
    size = frame.grid.voxel_size_m
    columns = np.concatenate([frame.density.sum(axis=axis, dtype=np.float64).ravel() for axis in range(3)]) * size
    filled = columns[columns > 1e-3 * columns.max()] if columns.max() > 0.0 else columns[:0]
    if not filled.size:
        raise VolumeError("this frame holds no smoke, so no optical depth can be given to it; choose another frame")
    return float(optical_depth / np.percentile(filled, percentile))
