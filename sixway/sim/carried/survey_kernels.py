# mypy: ignore-errors
"""Warp kernels that find the blocks with anything to carry, so that `advection_kernels` can skip the others.

The skipped voxels are exactly 0 with and without skipping. Nothing waits for the device: how far smoke can come is
reckoned from the fastest air on the device itself.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

BLOCK = 4
"""Edge of a block of voxels [voxels]: what holds no smoke is skipped block by block."""
SOLID_BIT = 1 << 30
"""Flag of a block with a solid voxel in reach; bit f says that field f may be non-zero there."""


@wp.kernel
def fastest_in_rows(first: int, velocity: wp.array3d[wp.vec3], fastest: wp.array2d[wp.float32]):
    """Largest component of the velocity [cells/step] in each row of cells."""
    row, j = wp.tid()
    k = first + row
    most = float(0.0)
    for i in range(velocity.shape[2]):
        most = wp.max(most, wp.max(wp.abs(velocity[k, j, i])))
    fastest[k, j] = most


@wp.kernel
def greatest_in_rows(first: int, values: wp.array2d[wp.float32], greatest: wp.array[wp.float32]):
    row = first + wp.tid()
    most = float(0.0)
    for i in range(values.shape[1]):
        most = wp.max(most, values[row, i])
    greatest[row] = most


@wp.kernel
def survey(
    first: int,
    fraction: wp.array3d[wp.float32],
    solid_before: wp.array3d[wp.uint8],
    fields: wp.array4d[wp.float32],
    solid: wp.array3d[wp.uint8],
    flags: wp.array3d[wp.int32],
):
    """What each block of voxels holds: fields that are not 0 everywhere, solid voxels before or now. Writes `solid`.

    fraction: part of a voxel that an obstacle fills; from 0.5 on it is solid. An empty array: no obstacles.
    """
    row, bj, bi = wp.tid()
    bk = first + row
    bits = int(0)
    k1 = wp.min((bk + 1) * BLOCK, fields.shape[1])
    j1 = wp.min((bj + 1) * BLOCK, fields.shape[2])
    i1 = wp.min((bi + 1) * BLOCK, fields.shape[3])
    if fraction.shape[0] > 0:
        for k in range(bk * BLOCK, k1):
            for j in range(bj * BLOCK, j1):
                for i in range(bi * BLOCK, i1):
                    now = fraction[k, j, i] >= 0.5
                    if now or int(solid_before[k, j, i]) != 0:
                        bits = bits | SOLID_BIT
                    solid[k, j, i] = wp.uint8(wp.where(now, 1, 0))
    for f in range(fields.shape[0]):
        full = bool(False)
        for k in range(bk * BLOCK, k1):
            for j in range(bj * BLOCK, j1):
                if not full:
                    for i in range(bi * BLOCK, i1):
                        if fields[f, k, j, i] != 0.0:
                            full = True
        if full:
            bits = bits | (1 << f)
    flags[bk, bj, bi] = bits


@wp.kernel
def spread(
    first: int,
    axis: int,
    periodic: bool,
    voxels_per_speed: float,
    fastest: wp.array[wp.float32],
    flags: wp.array3d[wp.int32],
    spread_flags: wp.array3d[wp.int32],
):
    """Flags of all blocks that a stencil of this block can touch, along one axis.

    A backtrace ends at most voxels_per_speed * fastest away, and its stencil reaches two voxels further.
    """
    row, j, i = wp.tid()
    k = first + row
    n = flags.shape[axis]
    here = wp.where(axis == 0, k, wp.where(axis == 1, j, i))
    voxels = wp.min(voxels_per_speed * fastest[0] * 1.0001, 1.0e6) + 2.001
    blocks = wp.min(int(wp.ceil(voxels / float(BLOCK))), n)
    if periodic:
        blocks += 1  # the last block may be cut short by the face
    bits = int(0)
    for step in range(-blocks, blocks + 1):
        there = here + step
        if periodic:
            there = ((there % n) + n) % n
        if there >= 0 and there < n:
            if axis == 0:
                bits = bits | flags[there, j, i]
            elif axis == 1:
                bits = bits | flags[k, there, i]
            else:
                bits = bits | flags[k, j, there]
    spread_flags[k, j, i] = bits
