"""Boxes of voxels that share one lattice: the box that holds several, and values moved from one to another."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Grid
from sixway.volumes.limits import VolumeError, check_size


def common_grid(grids: Sequence[tuple[str, Grid]]) -> Grid:
    """The smallest box on the voxels of the first grid that holds all of them; each comes with its source.

    Raises VolumeError if voxel sizes differ by more than 1 %, or if the box is too large.
    """
    source, first = grids[0]
    size = first.voxel_size_m
    for other, grid in grids:
        if abs(grid.voxel_size_m / size - 1.0) > 0.01:
            raise VolumeError(
                f"{other}: its voxels are {grid.voxel_size_m:g} m wide, those of {source} {size:g} m; "
                "resample them to one voxel size"
            )
    if all(grid == first for _, grid in grids):
        return first
    lower = np.min([grid.origin_m for _, grid in grids], axis=0)
    upper = np.max([np.add(grid.origin_m, grid.extent_m) for _, grid in grids], axis=0)
    lower = np.array(first.origin_m) - np.ceil((np.array(first.origin_m) - lower) / size - 1e-3) * size
    x, y, z = (int(n) for n in np.ceil((upper - lower) / size - 1e-3))
    check_size(source, (z, y, x))
    return Grid(shape_zyx=(z, y, x), voxel_size_m=size, origin_m=(float(lower[0]), float(lower[1]), float(lower[2])))


def moved(values: Float[np.ndarray, "z y x"], source: Grid, target: Grid) -> Float[np.ndarray, "z2 y2 x2"]:
    """Values of `source` in the box of `target`, moved by whole voxels; 0 around them, cut off outside."""
    if source == target:
        return values
    first = [round((a - b) / target.voxel_size_m) for a, b in zip(source.origin_m, target.origin_m, strict=True)]
    larger = np.zeros(target.shape_zyx, np.float32)
    there, here = [], []
    for start, size, whole in zip(reversed(first), values.shape, target.shape_zyx, strict=True):
        low, high = max(start, 0), min(start + size, whole)
        there.append(slice(low, max(low, high)))
        here.append(slice(low - start, max(low, high) - start))
    larger[tuple(there)] = values[tuple(here)]
    return larger
