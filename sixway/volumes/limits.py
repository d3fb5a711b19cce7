"""Bounds that a volume file must respect before any memory is given to it: files are hostile."""

from pathlib import Path

import numpy as np

LARGEST_VOXELS = 1 << 30
LARGEST_FILE_BYTES = 8 << 30
# Advection of higher order undershoots zero a little beside sharp edges; more than this is no smoke
LARGEST_UNDERSHOOT = 0.01


class VolumeError(ValueError):
    """A volume that cannot be read as smoke; the message names the file, the rule and the remedy."""


def read_bounded(path: Path) -> bytes:
    """All bytes of a file; raises VolumeError for one larger than `LARGEST_FILE_BYTES`."""
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise VolumeError(f"{path}: larger than {LARGEST_FILE_BYTES} bytes; crop or resample the grid")
    return path.read_bytes()


def check_size(source: str, shape_zyx: tuple[int, int, int]) -> None:
    """Raise VolumeError unless the shape is positive and at most `LARGEST_VOXELS` voxels."""
    z, y, x = shape_zyx
    if min(shape_zyx) < 1 or z * y * x > LARGEST_VOXELS:
        raise VolumeError(
            f"{source}: a grid of {x} x {y} x {z} voxels is refused; sizes run from 1 to {LARGEST_VOXELS} voxels "
            "in all: resample it, or check that the file is not damaged"
        )


def cubic_voxel(source: str, voxel_size: tuple[float, float, float]) -> float:
    """The one edge of a voxel; raises VolumeError if the three differ by more than 2 %."""
    smallest, largest = min(voxel_size), max(voxel_size)
    # each by itself: min and max overlook a NaN
    if not (all(1e-30 < edge < 1e30 for edge in voxel_size) and largest / smallest <= 1.02):
        raise VolumeError(f"{source}: voxels of {voxel_size} are not cubes; resample the grid to equal edges")
    if smallest == largest:
        return smallest
    return float(voxel_size[0] * voxel_size[1] * voxel_size[2]) ** (1.0 / 3.0)


def checked_density(source: str, density: np.ndarray) -> np.ndarray:
    """The density, its slight undershoots set to 0; raises VolumeError if it holds NaN or is negative.

    density: [z, y, x] float32, left as it is where nothing has to change.
    """
    lowest, highest = float(density.min()), float(density.max())
    if np.isfinite(lowest) and np.isfinite(highest):
        if lowest >= 0.0:
            return density
        if -lowest <= LARGEST_UNDERSHOOT * highest:
            return np.maximum(density, np.float32(0.0))
    bad = int(np.count_nonzero(~(np.isfinite(density) & (density >= 0.0))))
    raise VolumeError(
        f"{source}: density holds {bad} NaN, infinite or negative values (lowest {lowest:g}): if it is a distance "
        "field, convert it to a fog volume, else repair it"
    )
