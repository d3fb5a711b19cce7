"""A frame of smoke on the device, and where in it there is anything to be seen."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Bool, Float, Int8

from sixway.bands import RowBands
from sixway.core.frames import Grid
from sixway.core.records import DensityFrame, Medium
from sixway.guide import smoke_kernels
from sixway.guide.smoke_kernels import Volume

_EMPTY_OPTICAL_DEPTH = 1e-6
"""A voxel thinner than this counts as empty, as in the reference: advected smoke trails off over half the box."""

_EMPTY_EMISSION = 1e-6
"""A voxel with less than this part of the frame's brightest fire counts as dark."""

_DEPTH_THRESHOLD = 1e-3
"""Smoke begins where density exceeds this part of the frame's maximum (the paper's tau)."""

_FARTHEST = 8
"""Rays skip empty air by at most this many blocks at once."""


@dataclass(frozen=True)
class Smoke:
    """What every view of a frame shares. Lengths in metres from the grid's corner, (x, y, z).

    boxes: lower and upper corners of the blocks of voxels that hold smoke or fire. low, high: `box_around` them.
    """

    volume: Volume
    boxes: Float[np.ndarray, "n 2 3"]
    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]


def upload(
    frame: DensityFrame, medium: Medium, *, mip: int, emission: bool, device: wp.Device, bands: RowBands
) -> Smoke | None:
    """The frame on the device, averaged over boxes of `mip`^3 voxels; None if there is nothing to be seen.

    emission: whether fire is to be seen.
    """
    grid, edge = frame.grid, smoke_kernels.BLOCK
    volume = Volume()
    volume.voxel_m, volume.obstacle_voxel_m = grid.voxel_size_m * mip, grid.voxel_size_m
    volume.extinction_per_m, volume.albedo, volume.hg_g = medium.extinction_per_m, medium.grey_albedo, medium.hg_g
    volume.density = _averaged(frame.density, mip, device=device, bands=bands)
    peaks = block_peaks(volume.density, edge, device=device, bands=bands)
    volume.depth_threshold = _DEPTH_THRESHOLD * float(peaks.max())
    full = peaks > _EMPTY_OPTICAL_DEPTH / max(medium.extinction_per_m * grid.voxel_size_m, 1e-30)
    volume.emission = wp.empty((0, 0, 0), dtype=float, device=device)
    if emission and frame.emission is not None and frame.emission.any():
        volume.emission = _averaged(frame.emission, mip, device=device, bands=bands)
        peaks = block_peaks(volume.emission, edge, device=device, bands=bands)
        full = full | (peaks > _EMPTY_EMISSION * float(peaks.max()))
    if not full.any():
        return None
    boxes = block_boxes(full, volume.voxel_m, grid)
    low, high = box_around(boxes)
    volume.to_smoke = wp.array(block_distances(full), dtype=wp.int8, device=device)
    volume.seen_low, volume.seen_high = wp.vec3(*low), wp.vec3(*high)
    volume.obstacle = wp.empty((0, 0, 0), dtype=float, device=device)
    volume.to_solid = wp.empty((0, 0, 0), dtype=wp.int8, device=device)
    if frame.obstacle is not None:
        obstacle = _averaged(frame.obstacle, 1, device=device, bands=bands)
        walls = block_peaks(obstacle, edge * mip, device=device, bands=bands) > 0.0
        if walls.any():
            volume.obstacle = obstacle
            volume.to_solid = wp.array(block_distances(walls), dtype=wp.int8, device=device)
            wall_low, wall_high = box_around(block_boxes(walls, volume.voxel_m, grid))
            volume.seen_low = wp.vec3(*np.minimum(low, wall_low))
            volume.seen_high = wp.vec3(*np.maximum(high, wall_high))
    return Smoke(volume=volume, boxes=boxes, low=low, high=high)


def _averaged(field: Float[np.ndarray, "z y x"], edge: int, *, device: wp.Device, bands: RowBands) -> wp.array:
    on_device = wp.array(np.ascontiguousarray(field), dtype=float, device=device, copy=device.is_cuda)
    return on_device if edge == 1 else box_average(on_device, edge, device=device, bands=bands)


def box_average(field: wp.array, edge: int, *, device: wp.Device, bands: RowBands) -> wp.array:
    """Means over boxes of edge^3 voxels; voxels that the last boxes lack count as empty."""
    shape = tuple(-(-n // edge) for n in field.shape)
    mean = wp.empty(shape, dtype=float, device=device)
    bands.launch(smoke_kernels.box_average, dim=shape, inputs=[field, edge], outputs=[mean])
    return mean


def block_peaks(field: wp.array, edge: int, *, device: wp.Device, bands: RowBands) -> Float[np.ndarray, "bz by bx"]:
    """Bounds on the interpolated field, >= 0, in every block of edge^3 voxels: it reaches one voxel beyond."""
    shape = tuple(-(-n // edge) for n in field.shape)
    rows = wp.empty((*shape[:2], field.shape[2]), dtype=float, device=device)
    peaks = wp.empty(shape, dtype=float, device=device)
    bands.launch(smoke_kernels.block_peaks, dim=shape[:2], inputs=[field, edge], outputs=[rows, peaks])
    return peaks.numpy()


def block_distances(full: Bool[np.ndarray, "bz by bx"]) -> Int8[np.ndarray, "bz by bx"]:
    """Blocks from each block to the nearest full one, along the longest axis, up to `_FARTHEST`; 0 in full ones.

    A cube of that many blocks less one around an empty block is empty as well.
    """
    distances = np.where(full, 0, _FARTHEST).astype(np.int8)
    for axis in range(3):  # the largest of three distances is found an axis at a time
        near = np.moveaxis(distances, axis, 0)
        nearest = near.copy()
        for away in range(1, min(_FARTHEST, len(near))):
            np.minimum(nearest[away:], np.maximum(near[:-away], away), out=nearest[away:])
            np.minimum(nearest[:-away], np.maximum(near[away:], away), out=nearest[:-away])
        distances = np.moveaxis(nearest, 0, axis)
    return np.ascontiguousarray(distances)


def block_boxes(full: Bool[np.ndarray, "bz by bx"], voxel_m: float, grid: Grid) -> Float[np.ndarray, "n 2 3"]:
    """Lower and upper corners (x, y, z) of full blocks [m], within the grid: the last blocks may jut out.

    At the grid's faces with the half voxel over which interpolation fades out: smoke that leaves through a face ends
    there, as in the reference.
    """
    first = np.argwhere(full)[:, ::-1]
    corners = np.stack([first, first + 1], axis=1) * (smoke_kernels.BLOCK * voxel_m)
    extent_m = np.array(grid.extent_m)
    at_face = corners > extent_m - 1e-3 * voxel_m  # the product of whole numbers and metres may fall short by a bit
    return np.where(corners <= 0.0, -0.5 * voxel_m, np.where(at_face, extent_m + 0.5 * voxel_m, corners))


def box_around(boxes: Float[np.ndarray, "n 2 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Lower and upper corner of the box around boxes."""
    return boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
