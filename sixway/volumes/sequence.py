"""Several volumes as one sequence: one box that holds them all, one density scale, no jumps in between.

A sparse file covers only what is filled, so the box of each frame is another. Framed one by one, smoke
would swim in the picture.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.extinction import DEFAULT_OPTICAL_DEPTH, extinction_for_optical_depth
from sixway.volumes.limits import VolumeError, check_size
from sixway.volumes.read import Up, read_volume


@dataclass(frozen=True, kw_only=True)
class VolumeSequence:
    """Volumes in order. grid: the box of them all. extinction_per_m: brings the densest frame to the optical
    depth that was asked for. highest_density: over all frames."""

    paths: tuple[Path, ...]
    up: Up
    grid_name: str | None
    grid: Grid
    extinction_per_m: float
    highest_density: float

    def read(self, number: int) -> DensityFrame:
        """Frame `number` in the common box."""
        return placed(read_volume(self.paths[number], up=self.up, grid_name=self.grid_name), self.grid)


def open_sequence(
    paths: list[Path],
    *,
    up: Up = "y",
    grid_name: str | None = None,
    optical_depth: float = DEFAULT_OPTICAL_DEPTH,
) -> VolumeSequence:
    """Read every frame once and measure the whole.

    Raises VolumeError if no frame holds smoke, or if voxel sizes differ by more than 1 %.
    """
    grids, extinctions, highest = [], [], 0.0
    for path in paths:
        frame = read_volume(path, up=up, grid_name=grid_name)
        if frame.density.any():
            grids.append((path, frame.grid))
            extinctions.append(extinction_for_optical_depth(frame, optical_depth=optical_depth))
            highest = max(highest, float(frame.density.max()))
    if not grids:
        raise VolumeError(f"{paths[0]}: holds no smoke, nor do the {len(paths) - 1} after it; choose another grid")
    return VolumeSequence(
        paths=tuple(paths),
        up=up,
        grid_name=grid_name,
        grid=_union(grids),
        extinction_per_m=min(extinctions),
        highest_density=highest,
    )


def placed(frame: DensityFrame, grid: Grid) -> DensityFrame:
    """The frame's density, obstacles and fire in a larger box, moved by whole voxels; its wind stays behind."""
    if frame.grid == grid:
        return frame
    first = [round((a - b) / grid.voxel_size_m) for a, b in zip(frame.grid.origin_m, grid.origin_m, strict=True)]

    def moved(volume: np.ndarray) -> np.ndarray:
        larger = np.zeros(grid.shape_zyx, np.float32)
        target, source = [], []
        for start, size, whole in zip(reversed(first), volume.shape, grid.shape_zyx, strict=True):
            low, high = max(start, 0), min(start + size, whole)
            target.append(slice(low, max(low, high)))
            source.append(slice(low - start, max(low, high) - start))
        larger[tuple(target)] = volume[tuple(source)]
        return larger

    return DensityFrame(
        density=moved(frame.density),
        grid=grid,
        time_s=frame.time_s,
        obstacle=None if frame.obstacle is None else moved(frame.obstacle),
        emission=None if frame.emission is None else moved(frame.emission),
    )


def _union(grids: list[tuple[Path, Grid]]) -> Grid:
    """The smallest box on the voxels of the first grid that holds all of them."""
    first = grids[0][1]
    size = first.voxel_size_m
    for path, grid in grids:
        if abs(grid.voxel_size_m / size - 1.0) > 0.01:
            raise VolumeError(
                f"{path}: its voxels are {grid.voxel_size_m:g} m wide, those of {grids[0][0].name} {size:g} m; "
                "resample the sequence to one voxel size"
            )
    if all(grid == first for _, grid in grids):
        return first
    lower = np.min([grid.origin_m for _, grid in grids], axis=0)
    upper = np.max([np.add(grid.origin_m, grid.extent_m) for _, grid in grids], axis=0)
    lower = np.array(first.origin_m) - np.ceil((np.array(first.origin_m) - lower) / size - 1e-3) * size
    x, y, z = (int(n) for n in np.ceil((upper - lower) / size - 1e-3))
    check_size(str(grids[0][0].parent), (z, y, x))
    return Grid(shape_zyx=(z, y, x), voxel_size_m=size, origin_m=(float(lower[0]), float(lower[1]), float(lower[2])))


def slice_frames(paths: list[Path], text: str | None) -> list[Path]:
    """The frames that ``A:B`` names, B excluded; all of them for None. Raises ValueError."""
    if text is None:
        return paths
    first, colon, last = text.partition(":")
    if not (colon and first.isdigit() and last.isdigit() and 0 <= int(first) < int(last) <= len(paths)):
        raise ValueError(f"--frames {text!r} is not A:B with 0 <= A < B <= {len(paths)}, the volumes found")
    return paths[int(first) : int(last)]
