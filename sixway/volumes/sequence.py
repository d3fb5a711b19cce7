"""Several volumes as one sequence: one box that holds them all, one density scale, no jumps in between.

A sparse file covers only what is filled, so the box of each frame is another. Framed one by one, smoke
would swim in the picture.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.boxes import common_grid, moved
from sixway.volumes.extinction import (
    DEFAULT_OPTICAL_DEPTH,
    DEFAULT_RADIANCE,
    extinction_for_optical_depth,
    thick_column,
)
from sixway.volumes.fire import EmissionRule
from sixway.volumes.limits import VolumeError
from sixway.volumes.read import Up, read_volume

_FIRE_BY_NAME = EmissionRule()


@dataclass(frozen=True, kw_only=True)
class VolumeSequence:
    """Volumes in order. grid: the box of them all. extinction_per_m: brings the densest frame to the optical
    depth that was asked for. highest_density: over all frames. emission: how their fire is read, its strength
    settled; None if none of them could burn, else every frame has emission, 0 where it does not burn."""

    paths: tuple[Path, ...]
    up: Up
    grid_name: str | None
    grid: Grid
    extinction_per_m: float
    highest_density: float
    emission: EmissionRule | None

    def read(self, number: int) -> DensityFrame:
        """Frame `number` in the common box."""
        path = self.paths[number]
        frame = placed(read_volume(path, up=self.up, grid=self.grid_name, emission=self.emission), self.grid)
        if self.emission is None or frame.emission is not None:
            return frame
        return replace(frame, emission=np.zeros_like(frame.density))


def open_sequence(
    paths: list[Path],
    *,
    up: Up = "y",
    grid_name: str | None = None,
    optical_depth: float = DEFAULT_OPTICAL_DEPTH,
    emission: EmissionRule | None = _FIRE_BY_NAME,
) -> VolumeSequence:
    """Read every frame once and measure the whole. emission: as for `read_volume`.

    Raises VolumeError if no frame holds smoke, or if voxel sizes differ by more than 1 %.
    """
    grids, extinctions, highest = [], [], 0.0
    burns, thickest_fire = False, 0.0
    for path in paths:
        frame = read_volume(path, up=up, grid=grid_name, emission=emission)
        fire = frame.emission
        if frame.density.any() or (fire is not None and fire.any()):
            grids.append((str(path), frame.grid))
        if frame.density.any():
            extinctions.append(extinction_for_optical_depth(frame, optical_depth=optical_depth))
            highest = max(highest, float(frame.density.max()))
        if fire is not None:
            burns, thickest_fire = True, max(thickest_fire, thick_column(fire, frame.grid.voxel_size_m))
    if not extinctions:
        raise VolumeError(f"{paths[0]}: holds no smoke, nor do the {len(paths) - 1} after it; choose another grid")
    if emission is not None and emission.strength_per_m is None and thickest_fire > 0.0:
        emission = replace(emission, strength_per_m=DEFAULT_RADIANCE / thickest_fire)
    return VolumeSequence(
        paths=tuple(paths),
        up=up,
        grid_name=grid_name,
        grid=common_grid(grids),
        extinction_per_m=min(extinctions),
        highest_density=highest,
        emission=emission if burns else None,
    )


def placed(frame: DensityFrame, grid: Grid) -> DensityFrame:
    """The frame's density, obstacles and fire in a larger box, moved by whole voxels; its wind stays behind."""
    if frame.grid == grid:
        return frame
    return DensityFrame(
        density=moved(frame.density, frame.grid, grid),
        grid=grid,
        time_s=frame.time_s,
        obstacle=None if frame.obstacle is None else moved(frame.obstacle, frame.grid, grid),
        emission=None if frame.emission is None else moved(frame.emission, frame.grid, grid),
    )


def slice_frames(paths: list[Path], text: str | None) -> list[Path]:
    """The frames that ``A:B`` names, B excluded; all of them for None. Raises ValueError."""
    if text is None:
        return paths
    first, colon, last = text.partition(":")
    if not (colon and first.isdigit() and last.isdigit() and 0 <= int(first) < int(last) <= len(paths)):
        raise ValueError(f"--frames {text!r} is not A:B with 0 <= A < B <= {len(paths)}, the volumes found")
    return paths[int(first) : int(last)]
