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
    """sigma_t, solid, emission: [z, y, x] float32, extinction [1/m], solid fraction, emitted radiance [1/m].

    `grid` says where they are.

    The outermost voxels are empty. Interpolation between voxel centres then falls to zero inside the
    grid, keeps the mass of every voxel, and never meets a sharp edge at the box's face.
    """

    sigma_t: Float[np.ndarray, "z y x"]
    solid: Float[np.ndarray, "z y x"]
    emission: Float[np.ndarray, "z y x"]
    grid: Grid


def padded(frame: DensityFrame, medium: Medium) -> Extinction:
    """The whole frame with one empty voxel around it."""
    z, y, x = frame.grid.shape_zyx
    return _cut(frame, medium, lower=(0, 0, 0), upper=(z, y, x))


def cropped(frame: DensityFrame, medium: Medium) -> Extinction | None:
    """The part that holds smoke or obstacles, with one empty voxel around it; None without smoke.

    Voxels thinner than `_EMPTY_OPTICAL_DEPTH` are no smoke: through 100 of them, 1e-4 of the light is lost.
    """
    return _cut_around(frame, medium, _is_smoke(frame, medium))


def cropped_to_fire(frame: DensityFrame, medium: Medium) -> Extinction | None:
    """The part that holds fire, smoke or obstacles, with one empty voxel around it; None without fire."""
    if frame.emission is None or not frame.emission.any():
        return None
    return _cut_around(frame, medium, (frame.emission > 0.0) | _is_smoke(frame, medium))


def _is_smoke(frame: DensityFrame, medium: Medium) -> Bool[np.ndarray, "z y x"]:
    return frame.density * (medium.extinction_per_m * frame.grid.voxel_size_m) > _EMPTY_OPTICAL_DEPTH


def _cut_around(frame: DensityFrame, medium: Medium, matters: Bool[np.ndarray, "z y x"]) -> Extinction | None:
    if not matters.any():
        return None
    if frame.obstacle is not None:
        matters = matters | (frame.obstacle > 0.0)  # a solid in front of the smoke hides it
    lower, upper = [], []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        filled = np.flatnonzero(matters.any(axis=others))
        lower.append(int(filled[0]))
        upper.append(int(filled[-1]) + 1)
    return _cut(frame, medium, lower=(lower[0], lower[1], lower[2]), upper=(upper[0], upper[1], upper[2]))


def coarsened(extinction: Extinction, factor: int) -> Extinction:
    """The means over blocks of factor^3 voxels, with one empty block around them."""
    if factor == 1:
        return extinction
    grid = extinction.grid
    ends = [(factor, factor + -size % factor) for size in grid.shape_zyx]
    x, y, z = (origin - factor * grid.voxel_size_m for origin in grid.origin_m)
    sigma_t, solid, emission = (
        _block_means(np.pad(field, ends), factor)
        for field in (extinction.sigma_t, extinction.solid, extinction.emission)
    )
    depth, height, width = sigma_t.shape
    coarse = Grid(shape_zyx=(depth, height, width), voxel_size_m=factor * grid.voxel_size_m, origin_m=(x, y, z))
    return Extinction(sigma_t=sigma_t, solid=solid, emission=emission, grid=coarse)


def refined(extinction: Extinction) -> Extinction:
    """The same fields on voxels of half the edge: every old centre is one, and new ones lie in the middle between.

    Interpolation between the new centres gives what interpolation between the old ones gave.
    """
    grid = extinction.grid
    sigma_t, solid, emission = (
        _with_midpoints(field) for field in (extinction.sigma_t, extinction.solid, extinction.emission)
    )
    depth, height, width = sigma_t.shape
    half = 0.5 * grid.voxel_size_m
    x, y, z = (origin + 0.5 * half for origin in grid.origin_m)  # the outermost centres stay where they are
    fine = Grid(shape_zyx=(depth, height, width), voxel_size_m=half, origin_m=(x, y, z))
    return Extinction(sigma_t=sigma_t, solid=solid, emission=emission, grid=fine)


def _with_midpoints(values: Float[np.ndarray, "z y x"]) -> Float[np.ndarray, "z2 y2 x2"]:
    for axis in range(3):
        both = np.moveaxis(values, axis, 0)
        result = np.empty((2 * len(both) - 1, *both.shape[1:]), np.float32)
        result[::2], result[1::2] = both, 0.5 * (both[:-1] + both[1:])
        values = np.moveaxis(result, 0, axis)
    return np.ascontiguousarray(values)


def _block_means(values: Float[np.ndarray, "z y x"], factor: int) -> Float[np.ndarray, "z2 y2 x2"]:
    z, y, x = (size // factor for size in values.shape)
    return values.reshape(z, factor, y, factor, x, factor).mean(axis=(1, 3, 5))


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
    emission = np.zeros_like(sigma_t) if frame.emission is None else np.pad(frame.emission[window], 1)
    size = frame.grid.voxel_size_m
    x, y, z = (o + (low - 1) * size for o, low in zip(frame.grid.origin_m, reversed(lower), strict=True))
    depth, height, width = sigma_t.shape
    grid = Grid(shape_zyx=(depth, height, width), voxel_size_m=size, origin_m=(x, y, z))
    return Extinction(sigma_t=sigma_t, solid=solid, emission=emission, grid=grid)
