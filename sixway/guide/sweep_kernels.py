"""Warp kernels of the light grid: density in cells, optical depths by running sums, and scattered light."""

import warp as wp

from sixway.guide.ray_kernels import LANES, Lanes, exp_minus, trilinear_along
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


@wp.kernel
def light_coarse_cells(
    first_row: int,
    cells: wp.array3d(dtype=float),
    optical_depth: wp.array3d(dtype=Lanes),
    edge: int,
    density: wp.array3d(dtype=float),
    direct: wp.array3d(dtype=Lanes),
):
    """Mean density of blocks of edge^3 cells, and the part of each light that arrives at the smoke in them."""
    band_row, b, a = wp.tid()
    c = first_row + band_row
    total = float(0.0)
    lit = Lanes()
    for cc in range(c * edge, wp.min((c + 1) * edge, cells.shape[0])):
        for bb in range(b * edge, wp.min((b + 1) * edge, cells.shape[1])):
            for aa in range(a * edge, wp.min((a + 1) * edge, cells.shape[2])):
                if cells[cc, bb, aa] > 0.0:
                    total += cells[cc, bb, aa]
                    lit += cells[cc, bb, aa] * exp_minus(optical_depth[cc, bb, aa])
    density[c, b, a] = total / float(edge * edge * edge)
    direct[c, b, a] = lit / wp.max(total, 1.0e-30)


@wp.func
def is_inside(field: wp.array3d(dtype=float), c: int, b: int, a: int) -> bool:
    return c >= 0 and b >= 0 and a >= 0 and c < field.shape[0] and b < field.shape[1] and a < field.shape[2]


@wp.kernel
def scatter_along(
    first_row: int,
    cells: wp.array3d(dtype=float),
    extinction: float,
    way: wp.vec3i,
    albedo: float,
    share: float,
    turned: Lanes,
    turned_against: Lanes,
    seen: wp.vec2,
    direct: wp.array3d(dtype=Lanes),
    scattered: wp.array3d(dtype=Lanes),
    gathered: wp.array3d(dtype=Lanes),
):
    """Adds to every cell the light that all cells scatter along a line of cells and against it, and that reaches it.

    Each thread walks the line that starts at its cell, if one does. way: from a cell of the line to the next, along
    a, b, c. extinction: optical depth of density 1 from one to the next. share: part of all ways that one way stands
    for. turned, turned_against: parts of each direct light that scatter along the line and against it; light that has
    scattered before goes every way alike. seen: what the two count.
    The recurrence is exact for cells of even density and source: I' = I exp(-tau) + S (1 - exp(-tau)).
    """
    band_row, b, a = wp.tid()
    c = first_row + band_row
    if is_inside(cells, c - way[2], b - way[1], a - way[0]):
        return
    onwards = way
    part = turned
    for turn in range(2):
        arriving = Lanes()
        while is_inside(cells, c, b, a):
            passed = wp.exp(-0.5 * extinction * cells[c, b, a])
            source = wp.cw_mul(direct[c, b, a], part) + scattered[c, b, a] * share
            sent = source * (albedo * (1.0 - passed))
            middle = arriving * passed + sent
            gathered[c, b, a] = gathered[c, b, a] + middle * seen[turn]
            arriving = middle * passed + sent
            a += onwards[0]
            b += onwards[1]
            c += onwards[2]
        a -= onwards[0]
        b -= onwards[1]
        c -= onwards[2]
        onwards = -onwards
        part = turned_against
