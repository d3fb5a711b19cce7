"""A frame of smoke on the device, and the box that holds all of it that can be seen."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp
from jaxtyping import Float, Int32

from sixway.bands import RowBands
from sixway.core.records import DensityFrame, Medium
from sixway.guide import sweep_kernels

_EMPTY_OPTICAL_DEPTH = 1e-6
"""A voxel thinner than this counts as empty, as in the reference: advected smoke trails off over half the box."""

_DEPTH_THRESHOLD = 1e-3
"""Smoke begins where density exceeds this part of the frame's maximum (the paper's tau)."""

_FARTHEST = 8
"""Rays skip empty air by at most this many blocks at once."""


@dataclass(frozen=True)
class Smoke:
    """What every view of a frame shares. Lengths in metres from the grid's corner, (x, y, z).

    density: [z, y, x] on the device, averaged over the config's mip. voxel_m: edge of its voxels.
    obstacle: [z, y, x], of size 0 where there is none; obstacle_voxel_m: edge of its voxels.
    holds: what each block of voxels holds, [bz, by, bx]; see `block_contents`. boxes: see `smoke_boxes`.
    low, high: the box of smoke. seen_low, seen_high: the box of smoke and obstacles.
    depth_threshold: density at which smoke begins for the depth channel.
    """

    density: wp.array
    voxel_m: float
    obstacle: wp.array
    obstacle_voxel_m: float
    holds: wp.array
    boxes: Float[np.ndarray, "n 2 3"]
    low: np.ndarray
    high: np.ndarray
    seen_low: np.ndarray
    seen_high: np.ndarray
    depth_threshold: float


def upload(frame: DensityFrame, medium: Medium, *, mip: int, device: wp.Device, bands: RowBands) -> Smoke | None:
    """The frame on the device, averaged over boxes of `mip`^3 voxels; None if there is nothing to be seen."""
    size = frame.grid.voxel_size_m
    on_device = partial(wp.array, dtype=float, device=device, copy=device.is_cuda)
    density = on_device(frame.density)
    values = frame.density
    if mip > 1:
        density = box_average(density, mip, device=device, bands=bands)
        values = density.numpy()
    smallest = _EMPTY_OPTICAL_DEPTH / max(medium.extinction_per_m * size, 1e-30)
    box = support(values, above=smallest)
    if box is None:
        return None
    box = box[0], np.minimum(box[1], np.array(frame.density.shape[::-1]) / mip)  # the last boxes may jut out
    low, high = (corner * size * mip for corner in box)
    walls = support(frame.obstacle, above=0.0) if frame.obstacle is not None else None
    solid = frame.obstacle if walls is not None else None
    holds = block_contents(values, smallest, solid, mip)
    seen_low = low if walls is None else np.minimum(low, walls[0] * size)
    seen_high = high if walls is None else np.maximum(high, walls[1] * size)
    return Smoke(
        density=density,
        voxel_m=size * mip,
        obstacle=on_device(np.zeros((0, 0, 0), np.float32) if solid is None else solid),
        obstacle_voxel_m=size,
        holds=wp.array(holds, dtype=wp.int32, device=device),
        boxes=smoke_boxes(holds, box) * (size * mip),
        low=low,
        high=high,
        seen_low=seen_low,
        seen_high=seen_high,
        depth_threshold=_DEPTH_THRESHOLD * float(values.max()),
    )


def box_average(field: wp.array, edge: int, *, device: wp.Device, bands: RowBands) -> wp.array:
    """Means over boxes of edge^3 voxels; voxels that the last boxes lack count as empty."""
    shape = tuple(-(-n // edge) for n in field.shape)
    mean = wp.empty(shape, dtype=float, device=device)
    bands.launch(sweep_kernels.box_average, dim=shape, inputs=[field, edge], outputs=[mean])
    return mean


def support(field: np.ndarray, *, above: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners (x, y, z), in voxels within the grid, of where the interpolated field can exceed `above`."""
    across_z = field.max(axis=0)
    peaks = (across_z.max(axis=0), across_z.max(axis=1), field.max(axis=(1, 2)))
    filled = [np.flatnonzero(peak > above) for peak in peaks]
    if not all(len(indices) for indices in filled):
        return None
    # a voxel reaches half a voxel into its neighbours, where interpolation from its centre ends
    low = np.array([max(indices[0] - 0.5, 0.0) for indices in filled])
    high = np.array([min(indices[-1] + 1.5, len(peak)) for indices, peak in zip(filled, peaks, strict=True)])
    return low, high


def block_contents(
    density: np.ndarray, smallest: float, obstacle: np.ndarray | None, obstacle_ratio: int
) -> Int32[np.ndarray, "bz by bx"]:
    """What every block of `BLOCK`^3 voxels holds: bits `SMOKE` and `SOLID`, or minus the way to the nearest.

    obstacle_ratio: obstacle voxels along a density voxel. The way counts blocks along the longest axis, up to
    `_FARTHEST`: a cube of that many blocks less one around an empty block is empty as well.
    """
    edge = sweep_kernels.BLOCK
    holds = np.where(block_peaks(density, edge) > smallest, sweep_kernels.SMOKE, 0)
    if obstacle is not None:
        solid = block_peaks(obstacle, edge * obstacle_ratio) > 0.0
        holds |= np.where(solid, sweep_kernels.SOLID, 0)
    near = holds > 0
    for distance in range(1, _FARTHEST):
        wider = near
        for axis in range(3):
            wider = np.swapaxes(wider, 0, axis)
            grown = wider.copy()
            grown[1:] |= wider[:-1]
            grown[:-1] |= wider[1:]
            wider = np.swapaxes(grown, 0, axis)
        holds[wider & ~near] = -distance
        near = wider
    holds[~near] = -_FARTHEST
    return holds.astype(np.int32)


def smoke_boxes(holds: Int32[np.ndarray, "bz by bx"], box: tuple[np.ndarray, np.ndarray]) -> Float[np.ndarray, "n 2 3"]:
    """Lower and upper corners (x, y, z), in voxels, of boxes that together hold all smoke within `box`."""
    full = np.argwhere((holds > 0) & (holds & sweep_kernels.SMOKE > 0))[:, ::-1]
    corners = np.stack([full, full + 1], axis=1) * float(sweep_kernels.BLOCK)
    return np.clip(corners, *box)


def block_peaks(field: np.ndarray, edge: int) -> np.ndarray:
    """Bounds on the interpolated field in every block of edge^3 voxels: it reaches one voxel beyond."""
    for _ in range(3):  # an axis at a time, each in front once: whole planes are compared
        starts = range(0, len(field), edge)
        peaks = np.stack([field[max(start - 1, 0) : start + edge + 1].max(axis=0) for start in starts])
        field = np.moveaxis(peaks, 0, -1)
    return field
