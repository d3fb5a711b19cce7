"""How dense is a stranger's density, how bright its fire? Maxima run from 1 to 50; the eye wants one scale."""

import numpy as np
from jaxtyping import Float

from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError

DEFAULT_OPTICAL_DEPTH = 8.0
DEFAULT_RADIANCE = 2.0
"""Of fire through its thick columns, before smoke takes its share: what is left outshines smoke in the sun."""


def extinction_for_optical_depth(
    frame: DensityFrame, *, optical_depth: float = DEFAULT_OPTICAL_DEPTH, percentile: float = 99.0
) -> float:
    """Extinction per density [1/m] that gives the frame's thick columns that optical depth.

    Columns run along x, y and z; the percentile is taken over those that hold smoke. Raises VolumeError
    for an empty frame.
    """
    if not frame.density.any():
        raise VolumeError("this frame holds no smoke, so no optical depth can be given to it; choose another frame")
    return optical_depth / thick_column(frame.density, frame.grid.voxel_size_m, percentile=percentile)


def thick_column(values: Float[np.ndarray, "z y x"], voxel_size_m: float, *, percentile: float = 99.0) -> float:
    """That percentile of the values' integrals [m] along x, y and z, over columns that hold any; 0 without."""
    columns = np.concatenate([values.sum(axis=axis, dtype=np.float64).ravel() for axis in range(3)]) * voxel_size_m
    filled = columns[columns > 1e-3 * columns.max()]
    return float(np.percentile(filled, percentile)) if filled.size else 0.0
