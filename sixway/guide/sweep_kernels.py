"""Warp kernels of the swept guide: the light grid, and the view march that reads it. `oracle.py` says the same."""

import warp as wp

from sixway.guide.kernels import henyey_greenstein, ray_forward, ray_origin, slab, trilinear, uniform_hash

wp.set_module_options({"enable_backward": False})

SixLights = wp.types.vector(length=6, dtype=wp.float32)
"""One value a light, in the order of `DIRECTIONS`."""

SMALLEST_TRANSMITTANCE = wp.constant(1.0e-4)
"""A ray that has less left ends."""

SMALLEST_SLAB = wp.constant(1.0e-3)
"""Slabs that are more transparent than this wait to be lit together with those behind them."""

BLOCK = wp.constant(4)
"""Edge in voxels of the blocks by which rays skip empty air; see `smoke.block_contents`."""

SMOKE = wp.constant(1)
SOLID = wp.constant(2)
"""Bits of what a block holds. A block that holds neither has its distance to one that does, negative."""


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


@wp.func
def steps_to_smoke(voxel: wp.vec3, steps_a_voxel: wp.vec3, i: int, j: int, k: int, distance: int) -> int:
    """Steps, at least one, that take a sample from block (i, j, k) out of the cube of empty blocks around it.

    distance: in blocks, along the longest axis, to the nearest block that holds something.
    """
    low = wp.vec3(float(i), float(j), float(k)) * float(BLOCK)
    margin = float((distance - 1) * BLOCK)
    steps = float(1.0e6)
    for axis in range(3):
        pace = steps_a_voxel[axis]
        ahead = low[axis] + float(BLOCK) + margin - voxel[axis]
        behind = low[axis] - margin - voxel[axis]
        steps = wp.min(steps, wp.max(ahead * pace, behind * pace))
    return int(wp.max(wp.ceil(steps), 1.0))


@wp.kernel
def resample_density(
    first_row: int,
    density: wp.array3d(dtype=float),
    voxel_m: float,
    corner_m: wp.vec3,
    axes_m: wp.mat33,
    cells: wp.array3d(dtype=float),
):
    """Density at the centres of the light grid's cells.

    Cell (a, b, c) is stored at [c, b, a] and spans corner + axes @ [a, b, c] to corner + axes @ [a + 1, ...].
    """
    band_row, b, a = wp.tid()
    c = first_row + band_row
    centre = wp.vec3(float(a) + 0.5, float(b) + 0.5, float(c) + 0.5)
    cells[c, b, a] = trilinear(density, (corner_m + axes_m * centre) / voxel_m)


@wp.func
def cell_of_column(axis: int, first: int, second: int, n: int) -> wp.vec3i:
    """Index [c, b, a] of cell n of a column along an axis; first and second count the other two axes in order."""
    if axis == 0:
        return wp.vec3i(first, second, n)
    if axis == 1:
        return wp.vec3i(first, n, second)
    return wp.vec3i(n, first, second)


@wp.kernel
def sweep_lights(
    first_row: int,
    cells: wp.array3d(dtype=float),
    extinction: float,
    axis: int,
    optical_depth: wp.array3d(dtype=SixLights),
):
    """Optical depth from every cell's centre to the two lights along one axis; one thread a column of cells.

    extinction: optical depth across a cell of density 1. Along an axis of the grid the sum is exact.
    """
    band_row, second = wp.tid()
    first = first_row + band_row
    length = cells.shape[2 - axis]
    total = float(0.0)
    for n in range(length):
        at = cell_of_column(axis, first, second, n)
        total += cells[at[0], at[1], at[2]]
    passed = float(0.0)
    for n in range(length):
        at = cell_of_column(axis, first, second, n)
        half = 0.5 * cells[at[0], at[1], at[2]]
        passed += half
        # the first of a pair of lights (right, top, front) stands at the far end of the axis
        optical_depth[at[0], at[1], at[2]][2 * axis] = extinction * wp.max(total - passed, 0.0)
        optical_depth[at[0], at[1], at[2]][2 * axis + 1] = extinction * passed
        passed += half


@wp.kernel
def light_cells(first_row: int, optical_depth: wp.array3d(dtype=SixLights), direct: wp.array3d(dtype=SixLights)):
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
    share: float,
    direct: wp.array3d(dtype=SixLights),
    scattered: wp.array3d(dtype=SixLights),
    gathered: wp.array3d(dtype=SixLights),
):
    """Adds `share` of the light that direct and scattered light send along one axis, both ways, to every cell.

    The recurrence is exact for cells of even density and source: I' = I exp(-tau) + S (1 - exp(-tau)).
    """
    band_row, second = wp.tid()
    first = first_row + band_row
    length = cells.shape[2 - axis]
    for way in range(2):
        arriving = SixLights()
        for m in range(length):
            n = m
            if way == 1:
                n = length - 1 - m
            at = cell_of_column(axis, first, second, n)
            passed = wp.exp(-0.5 * extinction * cells[at[0], at[1], at[2]])
            sent = (direct[at[0], at[1], at[2]] + scattered[at[0], at[1], at[2]]) * (1.0 - passed)
            middle = arriving * passed + sent
            gathered[at[0], at[1], at[2]] = gathered[at[0], at[1], at[2]] + middle * share
            arriving = middle * passed + sent


@wp.func
def trilinear_lights(field: wp.array3d(dtype=SixLights), cell: wp.vec3) -> SixLights:
    """All lights at a position in cells; straight on through the outer half of the outermost cells."""
    i = wp.clamp(int(wp.floor(cell[0] - 0.5)), 0, field.shape[2] - 2)
    j = wp.clamp(int(wp.floor(cell[1] - 0.5)), 0, field.shape[1] - 2)
    k = wp.clamp(int(wp.floor(cell[2] - 0.5)), 0, field.shape[0] - 2)
    tx = wp.clamp(cell[0] - 0.5 - float(i), -0.5, 1.5)
    ty = wp.clamp(cell[1] - 0.5 - float(j), -0.5, 1.5)
    tz = wp.clamp(cell[2] - 0.5 - float(k), -0.5, 1.5)
    near = wp.lerp(
        wp.lerp(field[k, j, i], field[k, j, i + 1], tx),
        wp.lerp(field[k, j + 1, i], field[k, j + 1, i + 1], tx),
        ty,
    )
    far = wp.lerp(
        wp.lerp(field[k + 1, j, i], field[k + 1, j, i + 1], tx),
        wp.lerp(field[k + 1, j + 1, i], field[k + 1, j + 1, i + 1], tx),
        ty,
    )
    return wp.lerp(near, far, tz)


@wp.kernel
def march_swept(
    first_row: int,
    density: wp.array3d(dtype=float),
    voxel_m: float,
    obstacle: wp.array3d(dtype=float),
    obstacle_voxel_m: float,
    holds: wp.array3d(dtype=wp.int32),
    seen_low: wp.vec3,
    seen_high: wp.vec3,
    position_m: wp.vec3,
    to_target: wp.vec3,
    right: wp.vec3,
    up: wp.vec3,
    perspective: int,
    to_lights: wp.mat33,
    extinction_per_m: float,
    albedo: float,
    hg_g: float,
    step_m: float,
    light_samples: int,
    depth_threshold: float,
    jittered: int,
    seed: wp.uint32,
    optical_depth: wp.array3d(dtype=SixLights),
    scattered: wp.array3d(dtype=SixLights),
    corner_m: wp.vec3,
    to_cells: wp.mat33,
    in_scatter: wp.array2d(dtype=SixLights),
    transmittance: wp.array2d(dtype=float),
    depth_m: wp.array2d(dtype=float),
):
    """Density at every step, light once a slab of steps, where the slab's opacity has its centre of mass.

    A slab ends at 1 / light_samples of the ray's way through the smoke's box, or when it is that opaque.

    to_lights: rows are the world vectors to right, top and front. scattered: fluence of light that has scattered, in
    parts of the irradiance, in cells twice as large; of size 0 if it is left out. to_cells: metres to
    cells of the light grid.
    """
    band_row, column = wp.tid()
    row = first_row + band_row
    shape = wp.vec2(float(transmittance.shape[0]), float(transmittance.shape[1]))
    origin = ray_origin(row, column, shape, position_m, right, up, perspective)
    forward = ray_forward(row, column, shape, to_target, right, up, perspective)
    seen = slab(origin - seen_low, forward, seen_high - seen_low)
    steps = int(wp.ceil(wp.max(seen[1] - seen[0], 0.0) / step_m))
    steps_a_slab = wp.max((steps + light_samples - 1) / light_samples, 1)
    largest_slab = 1.0 / float(light_samples)
    offset = float(0.5)
    if jittered == 1:
        offset = uniform_hash(seed, wp.uint32(row * transmittance.shape[1] + column))
    start = seen[0] + offset * step_m
    voxel = (origin + start * forward) / voxel_m
    voxel_step = forward * (step_m / voxel_m)
    steps_a_voxel = wp.vec3()
    for axis in range(3):
        steps_a_voxel[axis] = 1.0e6
        if wp.abs(voxel_step[axis]) > 1.0e-6:
            steps_a_voxel[axis] = 1.0 / voxel_step[axis]
    cell = to_cells * (origin + start * forward - corner_m)
    cell_step = to_cells * (step_m * forward)

    lit = SixLights()
    glow = SixLights()
    remaining = float(1.0)
    depth = float(wp.inf)
    weight = float(0.0)  # opacity that waits to be lit
    moment = float(0.0)  # the same times the number of its step
    slab_end = int(steps_a_slab)
    n = int(0)
    while n < steps and remaining > SMALLEST_TRANSMITTANCE:
        here = voxel + float(n) * voxel_step
        i = wp.clamp(int(here[0]) / BLOCK, 0, holds.shape[2] - 1)
        j = wp.clamp(int(here[1]) / BLOCK, 0, holds.shape[1] - 1)
        k = wp.clamp(int(here[2]) / BLOCK, 0, holds.shape[0] - 1)
        held = holds[k, j, i]
        if held < 0:
            n += steps_to_smoke(here, steps_a_voxel, i, j, k, -held)
        else:
            if (held & SOLID) != 0:
                if trilinear(obstacle, here * (voxel_m / obstacle_voxel_m)) > 0.5:
                    break
            rho = trilinear(density, here)
            if rho > 0.0:
                if rho > depth_threshold and depth > 1.0e30:
                    depth = start + float(n) * step_m
                passed = remaining * wp.exp(-extinction_per_m * step_m * rho)
                weight += remaining - passed
                moment += (remaining - passed) * float(n)
                remaining = passed
            n += 1
        if n >= slab_end or weight > largest_slab:
            slab_end = n - n % steps_a_slab + steps_a_slab
            if weight > SMALLEST_SLAB:
                centre = cell + (moment / weight) * cell_step
                depths = trilinear_lights(optical_depth, centre)
                for light in range(6):
                    lit[light] += weight * wp.exp(-wp.max(depths[light], 0.0))
                if scattered.shape[0] > 0:
                    glow += weight * trilinear_lights(scattered, 0.5 * centre)
                weight = 0.0
                moment = 0.0
    if weight > 0.0:
        centre = cell + (moment / weight) * cell_step
        depths = trilinear_lights(optical_depth, centre)
        for light in range(6):
            lit[light] += weight * wp.exp(-wp.max(depths[light], 0.0))
        if scattered.shape[0] > 0:
            glow += weight * trilinear_lights(scattered, 0.5 * centre)
    if remaining < 1.0:
        for axis in range(3):
            cosine = wp.dot(to_lights[axis], forward)
            lit[2 * axis] = wp.pi * albedo * henyey_greenstein(cosine, hg_g) * lit[2 * axis]
            lit[2 * axis + 1] = wp.pi * albedo * henyey_greenstein(-cosine, hg_g) * lit[2 * axis + 1]
        for light in range(6):  # what has scattered before comes from all sides: pi / (4 pi)
            lit[light] += 0.25 * albedo * wp.max(glow[light], 0.0)
    in_scatter[row, column] = lit
    transmittance[row, column] = remaining
    depth_m[row, column] = depth
