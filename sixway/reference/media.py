"""From smoke to what a path tracer wants: extinction on a grid with an empty border."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame, Medium


_EMPTY_OPTICAL_DEPTH = 1e-6
"""A voxel thinner than this counts as empty: advected smoke trails off over half the box without being seen."""


@dataclass(frozen=True, kw_only=True)
class Extinction:
    """sigma_t and solid: [z, y, x] float32, extinction [1/m] and solid fraction; `grid`: where they are.

    The outermost voxels are empty. Interpolation between voxel centres then falls to zero inside the
    grid, keeps the mass of every voxel, and never meets a sharp edge at the box's face.
    """

    sigma_t: Float[np.ndarray, "z y x"]
    solid: Float[np.ndarray, "z y x"]
    grid: Grid


def padded(frame: DensityFrame, medium: Medium) -> Extinction:
    """The whole frame with one empty voxel around it."""
    z, y, x = frame.grid.shape_zyx
    return _cut(frame, medium, lower=(0, 0, 0), upper=(z, y, x))


def cropped(frame: DensityFrame, medium: Medium) -> Extinction | None:
    """The part that holds smoke or obstacles, with one empty voxel around it; None without smoke.

    Voxels thinner than `_EMPTY_OPTICAL_DEPTH` are no smoke: through 100 of them, 1e-4 of the light is lost.
    """
    matters = frame.density * (medium.extinction_per_m * frame.grid.voxel_size_m) > _EMPTY_OPTICAL_DEPTH
    if not matters.any():
        return None
    if frame.obstacle is not None:
        matters |= frame.obstacle > 0.0  # a solid in front of the smoke hides it
    lower, upper = [], []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        filled = np.flatnonzero(matters.any(axis=others))
        lower.append(int(filled[0]))
        upper.append(int(filled[-1]) + 1)
    return _cut(frame, medium, lower=(lower[0], lower[1], lower[2]), upper=(upper[0], upper[1], upper[2]))


def reached(sigma_t: Float[np.ndarray, "z y x"]) -> Bool[np.ndarray, "z y x"]:
    """Voxels whose values interpolation can ask for where there is smoke: smoke and its 26 neighbours.

    The outermost voxels of `sigma_t` must be empty.
    """
    mask = sigma_t > 0.0
    for axis in range(3):
        mask = mask | np.roll(mask, 1, axis) | np.roll(mask, -1, axis)  # nothing wraps: the border is empty
    return mask


def _cut(
    frame: DensityFrame, medium: Medium, *, lower: tuple[int, int, int], upper: tuple[int, int, int]
) -> Extinction:
    """Voxels [lower, upper) along z, y, x and one empty voxel around them."""
    window = tuple(slice(low, high) for low, high in zip(lower, upper, strict=True))
    sigma_t = np.pad(frame.density[window] * np.float32(medium.extinction_per_m), 1)
    sigma_t[sigma_t * frame.grid.voxel_size_m <= _EMPTY_OPTICAL_DEPTH] = 0.0
    solid = np.zeros_like(sigma_t) if frame.obstacle is None else np.pad(frame.obstacle[window], 1)
    size = frame.grid.voxel_size_m
    x, y, z = (o + (low - 1) * size for o, low in zip(frame.grid.origin_m, reversed(lower), strict=True))
    depth, height, width = sigma_t.shape
    grid = Grid(shape_zyx=(depth, height, width), voxel_size_m=size, origin_m=(x, y, z))
    return Extinction(sigma_t=sigma_t, solid=solid, grid=grid)
