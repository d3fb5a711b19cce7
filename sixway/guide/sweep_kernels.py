"""Warp kernels of the light grid: density in cells, optical depths by running sums, and scattered light."""

import warp as wp

from sixway.guide.ray_kernels import LANES, Lanes, trilinear_along
from sixway.guide.smoke_kernels import BLOCK, blocks_to_nearest

wp.set_module_options({"enable_backward": False})


_SWEEP_ROW = """
    const int n = cells.shape[2];
    const float* values = cells.data + (c * cells.shape[1] + b) * n;
    wp::vec_t<8, float>* depths = optical_depth.data + (c * cells.shape[1] + b) * n;
    const float half = 0.5f * extinction;
    float passed = 0.0f;
    for (int a = 0; a < n; ++a) {
        passed += half * values[a];
        depths[a].c[1] = passed;
        passed += half * values[a];
    }
    passed = 0.0f;
    for (int a = n - 1; a >= 0; --a) {
        passed += half * values[a];
        depths[a].c[0] = passed;
        passed += half * values[a];
    }
"""


@wp.func_native(_SWEEP_ROW)
def sweep_row(
    cells: wp.array3d(dtype=float), extinction: float, c: int, b: int, optical_depth: wp.array3d(dtype=Lanes)
):
    """From every cell of a row to the lights at both of its ends."""
    ...


@wp.kernel
def fill_rows(
    first_row: int,
    density: wp.array3d(dtype=float),
    blur: int,
    to_smoke: wp.array3d(dtype=wp.int8),
    corner_voxel: wp.vec3,
    axes_voxel: wp.mat33,
    extinction: float,
    cells: wp.array3d(dtype=float),
    optical_depth: wp.array3d(dtype=Lanes),
):
    """Density at the centres of a row of cells, and the optical depth from there to right and left.

    Cell (a, b, c) is stored at [c, b, a] and spans corner + axes @ [a, b, c] to corner + axes @ [a + 1, ...].
    blur: voxels of `to_smoke` along a voxel of density. extinction: optical depth across a cell of density 1.
    Along an axis of the grid the sum is exact.
    """
    band_row, b = wp.tid()
    c = first_row + band_row
    start = corner_voxel + axes_voxel * wp.vec3(0.5, float(b) + 0.5, float(c) + 0.5)
    step = wp.vec3(axes_voxel[0, 0], axes_voxel[1, 0], axes_voxel[2, 0])
    middle = (0.5 * float(LANES - 1) * float(blur)) * step
    reach = wp.max(wp.abs(middle)) + 2.0 * float(blur)  # of eight samples and of their interpolation, in voxels
    a = int(0)
    while a < cells.shape[2]:
        first = start + float(a) * step
        sampled = Lanes()
        if float((blocks_to_nearest(to_smoke, first * float(blur) + middle) - 1) * BLOCK) < reach:
            sampled = trilinear_along(density, first, step)
        for lane in range(wp.min(LANES, cells.shape[2] - a)):
            cells[c, b, a + lane] = sampled[lane]
        a += LANES
    sweep_row(cells, extinction, c, b, optical_depth)


@wp.kernel
def sweep_rows(
    first_row: int, cells: wp.array3d(dtype=float), extinction: float, optical_depth: wp.array3d(dtype=Lanes)
):
    """Optical depth from every cell's centre to right and left."""
    band_row, b = wp.tid()
    sweep_row(cells, extinction, first_row + band_row, b, optical_depth)


_SWEEP_ACROSS = """
    const int rows = axis == 1 ? cells.shape[1] : cells.shape[0];
    const int stride = (axis == 1 ? 1 : cells.shape[1]) * cells.shape[2];
    const int first = (axis == 1 ? plane * cells.shape[1] : plane) * cells.shape[2] + a_start;
    const int count = cells.shape[2] - a_start < width ? cells.shape[2] - a_start : width;
    const float half = 0.5f * extinction;
    for (int way = 0; way < 2; ++way) {
        // the second of a pair of lights (left, bottom, back) stands where the axis starts
        const int light = 2 * axis + 1 - way;
        for (int m = 0; m < rows; ++m) {
            const int n = way == 0 ? m : rows - 1 - m;
            const int before = first + (m == 0 ? n : way == 0 ? n - 1 : n + 1) * stride;
            const float* values = cells.data + first + n * stride;
            const float* values_before = cells.data + before;
            float* depths = optical_depth.data[first + n * stride].c + light;
            const float* depths_before = optical_depth.data[before].c + light;
            if (m == 0)
                for (int a = 0; a < count; ++a)
                    depths[8 * a] = half * values[a];
            else {
                #pragma clang loop vectorize(assume_safety)
                for (int a = 0; a < count; ++a)
                    depths[8 * a] = depths_before[8 * a] + half * (values_before[a] + values[a]);
            }
        }
    }
"""


@wp.func_native(_SWEEP_ACROSS)
def sweep_plane(
    cells: wp.array3d(dtype=float),
    extinction: float,
    axis: int,
    plane: int,
    a_start: int,
    width: int,
    optical_depth: wp.array3d(dtype=Lanes),
):
    """From every cell of a plane to the two lights along axis 1 or 2, for `width` columns of it."""
    ...


@wp.kernel
def sweep_across(
    first_row: int,
    cells: wp.array3d(dtype=float),
    extinction: float,
    axis: int,
    width: int,
    optical_depth: wp.array3d(dtype=Lanes),
):
    """Optical depth from every cell's centre to top and bottom (axis 1) or front and back (axis 2).

    Whole rows at a time, so that a CPU runs along memory; width: columns a thread takes.
    """
    band_row, part = wp.tid()
    sweep_plane(cells, extinction, axis, first_row + band_row, part * width, width, optical_depth)


@wp.func
def cell_of_column(axis: int, first: int, second: int, n: int) -> wp.vec3i:
    """Index [c, b, a] of cell n of a column along an axis; first and second count the other two axes in order."""
    if axis == 0:
        return wp.vec3i(first, second, n)
    if axis == 1:
        return wp.vec3i(first, n, second)
    return wp.vec3i(n, first, second)


@wp.kernel
def light_cells(first_row: int, optical_depth: wp.array3d(dtype=Lanes), direct: wp.array3d(dtype=Lanes)):
    """What arrives at each cell from each light, as a part of what the light sends."""
    band_row, b, a = wp.tid()
    c = first_row + band_row
    for light in range(6):
        direct[c, b, a][light] = wp.exp(-optical_depth[c, b, a][light])


@wp.kernel
def scatter_along(
    first_row: int,
    cells: wp.array3d(dtype=float),
    extinction: float,
    axis: int,
    albedo: float,
    turns: wp.vec3,
    seen: wp.vec2,
    direct: wp.array3d(dtype=Lanes),
    scattered: wp.array3d(dtype=Lanes),
    gathered: wp.array3d(dtype=Lanes),
):
    """Adds to every cell the light that all cells scatter along one axis, both ways, and that reaches it.

    turns: parts of direct light that scatter onwards, aside (each of four ways) and back; light that has scattered
    before goes every way alike. seen: what the two ways, up and down the axis, count.
    The recurrence is exact for cells of even density and source: I' = I exp(-tau) + S (1 - exp(-tau)).
    """
    band_row, second = wp.tid()
    first = first_row + band_row
    length = cells.shape[2 - axis]
    for way in range(2):
        turned = Lanes(turns[1])
        # the first of a pair of lights shines down its axis
        turned[2 * axis] = turns[2 - 2 * way]
        turned[2 * axis + 1] = turns[2 * way]
        arriving = Lanes()
        for m in range(length):
            n = m
            if way == 1:
                n = length - 1 - m
            at = cell_of_column(axis, first, second, n)
            passed = wp.exp(-0.5 * extinction * cells[at[0], at[1], at[2]])
            source = wp.cw_mul(direct[at[0], at[1], at[2]], turned) + scattered[at[0], at[1], at[2]] / 6.0
            sent = source * (albedo * (1.0 - passed))
            middle = arriving * passed + sent
            gathered[at[0], at[1], at[2]] = gathered[at[0], at[1], at[2]] + middle * seen[way]
            arriving = middle * passed + sent
