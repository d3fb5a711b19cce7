"""The volume as kernels take it: box averages, and blocks by which rays skip empty air."""

import warp as wp

from sixway.guide.ray_kernels import LANES, trilinear_along

wp.set_module_options({"enable_backward": False})

BLOCK = wp.constant(4)
"""Edge of a block in voxels."""

LARGEST_DIFFERENCE = wp.constant(0.02)
"""Pixels that differ more than this from a neighbour are marched again with more rays."""


@wp.struct
class Volume:
    """What rays pass through. Arrays [z, y, x]; those that a frame lacks have size 0.

    voxel_m: edge of the voxels of density and emission. extinction_per_m: of density 1.
    to_smoke, to_solid: blocks to the nearest that holds smoke or fire, or an obstacle; see `blocks_to_nearest`.
    seen_low, seen_high: box of all of it, metres from the grid's corner.
    depth_threshold: density at which smoke begins for the depth channel.
    """

    density: wp.array3d(dtype=float)
    emission: wp.array3d(dtype=float)
    obstacle: wp.array3d(dtype=float)
    voxel_m: float
    obstacle_voxel_m: float
    to_smoke: wp.array3d(dtype=wp.int8)
    to_solid: wp.array3d(dtype=wp.int8)
    seen_low: wp.vec3
    seen_high: wp.vec3
    extinction_per_m: float
    albedo: float
    hg_g: float
    depth_threshold: float


@wp.kernel
def box_average(first_row: int, fine: wp.array3d(dtype=float), edge: int, mean: wp.array3d(dtype=float)):
    """Mean over edge^3 voxels; those beyond the grid are empty."""
    band_row, j, i = wp.tid()
    k = first_row + band_row
    total = float(0.0)
    for kk in range(k * edge, wp.min((k + 1) * edge, fine.shape[0])):
        for jj in range(j * edge, wp.min((j + 1) * edge, fine.shape[1])):
            for ii in range(i * edge, wp.min((i + 1) * edge, fine.shape[2])):
                total += fine[kk, jj, ii]
    mean[k, j, i] = total / float(edge * edge * edge)


_PEAKS_OF_ROWS = """
    const int nx = field.shape[2], ny = field.shape[1], nz = field.shape[0];
    float* row = rows.data + (bk * rows.shape[1] + bj) * nx;
    const int k_end = (bk + 1) * edge + 1 < nz ? (bk + 1) * edge + 1 : nz;
    const int j_end = (bj + 1) * edge + 1 < ny ? (bj + 1) * edge + 1 : ny;
    const int k_start = bk > 0 ? bk * edge - 1 : 0, j_start = bj > 0 ? bj * edge - 1 : 0;
    for (int i = 0; i < nx; ++i)
        row[i] = 0.0f;
    for (int k = k_start; k < k_end; ++k)
        for (int j = j_start; j < j_end; ++j) {
            const float* values = field.data + ((long long)k * ny + j) * nx;
            #pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < nx; ++i)
                row[i] = row[i] < values[i] ? values[i] : row[i];
        }
    for (int bi = 0; bi < peaks.shape[2]; ++bi) {
        float peak = 0.0f;
        const int i_end = (bi + 1) * edge + 1 < nx ? (bi + 1) * edge + 1 : nx;
        for (int i = bi > 0 ? bi * edge - 1 : 0; i < i_end; ++i)
            peak = peak < row[i] ? row[i] : peak;
        peaks.data[(bk * peaks.shape[1] + bj) * peaks.shape[2] + bi] = peak;
    }
"""


@wp.func_native(_PEAKS_OF_ROWS)
def peaks_of_rows(
    field: wp.array3d(dtype=float),
    edge: int,
    bk: int,
    bj: int,
    rows: wp.array3d(dtype=float),
    peaks: wp.array3d(dtype=float),
):
    """The row of blocks (bk, bj), by way of the largest value over its rows of voxels."""
    ...


@wp.kernel
def block_peaks(
    first_row: int,
    field: wp.array3d(dtype=float),
    edge: int,
    rows: wp.array3d(dtype=float),
    peaks: wp.array3d(dtype=float),
):
    """Largest value that the interpolated field >= 0 can take in blocks of edge^3 voxels: it reaches a voxel beyond."""
    band_row, bj = wp.tid()
    peaks_of_rows(field, edge, first_row + band_row, bj, rows, peaks)


@wp.func
def blocks_to_nearest(distances: wp.array3d(dtype=wp.int8), voxel: wp.vec3) -> int:
    """Blocks, along the longest axis, from the block of a position in voxel units to the nearest that holds something.

    0 where the block itself does.
    """
    i = wp.clamp(int(voxel[0]) / BLOCK, 0, distances.shape[2] - 1)
    j = wp.clamp(int(voxel[1]) / BLOCK, 0, distances.shape[1] - 1)
    k = wp.clamp(int(voxel[2]) / BLOCK, 0, distances.shape[0] - 1)
    return int(distances[k, j, i])


@wp.func
def steps_to_nearest(voxel: wp.vec3, steps_a_voxel: wp.vec3, distance: int) -> int:
    """Steps, at least one, that take a position out of the cube of empty blocks around its own.

    steps_a_voxel: of the ray along each axis, signed. distance: of `blocks_to_nearest`, not 0.
    """
    edge = float(BLOCK)
    margin = float(distance - 1) * edge
    steps = float(1.0e6)
    for axis in range(3):
        left = voxel[axis] - wp.floor(voxel[axis] / edge) * edge
        if steps_a_voxel[axis] > 0.0:
            left = edge - left
        steps = wp.min(steps, (left + margin) * wp.abs(steps_a_voxel[axis]))
    return int(wp.max(wp.ceil(steps), 1.0))


@wp.func
def steps_to_wall(volume: Volume, voxel: wp.vec3, voxel_step: wp.vec3, steps_a_voxel: wp.vec3, steps: int) -> int:
    """Steps, up to `steps`, that a ray takes until an obstacle blocks it; positions in voxels of density."""
    ratio = volume.voxel_m / volume.obstacle_voxel_m
    n = int(0)
    while n < steps:
        here = voxel + float(n) * voxel_step
        distance = blocks_to_nearest(volume.to_solid, here)
        if distance > 0:
            n += steps_to_nearest(here, steps_a_voxel, distance)
        else:
            solid = trilinear_along(volume.obstacle, here * ratio, voxel_step * ratio)
            for lane in range(LANES):
                if solid[lane] > 0.5:
                    return wp.min(n + lane, steps)
            n += LANES
    return steps


@wp.func
def emitted_along(emission: float, step_m: float, depth: float, passed: float) -> float:
    """Radiance that a step adds, as a slab of even emission and extinction: eps h (1 - exp(-tau)) / tau.

    depth, passed: the step's tau and exp(-tau) (Chandrasekhar 1960, section 7).
    """
    if depth > 1.0e-3:
        return emission * step_m * (1.0 - passed) / depth
    return emission * step_m * (1.0 - 0.5 * depth)


@wp.kernel
def find_edges(first_row: int, transmittance: wp.array2d(dtype=float), edges: wp.array2d(dtype=wp.int8)):
    """1 where transmittance differs by more than LARGEST_DIFFERENCE among a pixel and its eight neighbours, else 0."""
    band_row, column = wp.tid()
    row = first_row + band_row
    low = float(1.0)
    high = float(0.0)
    for j in range(wp.max(row - 1, 0), wp.min(row + 2, transmittance.shape[0])):
        for i in range(wp.max(column - 1, 0), wp.min(column + 2, transmittance.shape[1])):
            low = wp.min(low, transmittance[j, i])
            high = wp.max(high, transmittance[j, i])
    edges[row, column] = wp.int8(high - low > LARGEST_DIFFERENCE)
