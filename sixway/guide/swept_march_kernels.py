"""Warp kernel of the swept guide's view march: density at every voxel, light once a slab."""

import warp as wp

from sixway.guide.ray_kernels import (
    LANES,
    Lanes,
    View,
    camera_ray,
    exp_minus,
    henyey_greenstein,
    image_point,
    slab,
    trilinear_along,
    uniform_hash,
)
from sixway.guide.smoke_kernels import Volume, blocks_to_nearest, emitted_along, steps_to_nearest, steps_to_wall

wp.set_module_options({"enable_backward": False})

SMALLEST_TRANSMITTANCE = wp.constant(1.0e-4)
"""A ray that has less left ends."""

SMALLEST_SLAB = wp.constant(1.0e-3)
"""Slabs that are more transparent than this wait to be lit together with those behind them."""

_TRILINEAR_LIGHTS = """
    const int na = field.shape[2], nb = field.shape[1], nc = field.shape[0];
    const float x = cell.c[0] - 0.5f, y = cell.c[1] - 0.5f, z = cell.c[2] - 0.5f;
    int i = (int)floorf(x), j = (int)floorf(y), k = (int)floorf(z);
    i = i < 0 ? 0 : (i > na - 2 ? na - 2 : i);
    j = j < 0 ? 0 : (j > nb - 2 ? nb - 2 : j);
    k = k < 0 ? 0 : (k > nc - 2 ? nc - 2 : k);
    float tx = x - i, ty = y - j, tz = z - k;
    tx = tx < -0.5f ? -0.5f : (tx > 1.5f ? 1.5f : tx);
    ty = ty < -0.5f ? -0.5f : (ty > 1.5f ? 1.5f : ty);
    tz = tz < -0.5f ? -0.5f : (tz > 1.5f ? 1.5f : tz);
    const float* near = field.data[(k * nb + j) * na + i].c;
    const float* far = near + 8 * nb * na;
    const int right = 8, above = 8 * na;
    wp::vec_t<8, float> lights;
    #pragma clang loop vectorize(assume_safety)
    for (int lane = 0; lane < 8; ++lane) {
        float below = near[lane] + tx * (near[lane + right] - near[lane]);
        float over = near[lane + above] + tx * (near[lane + above + right] - near[lane + above]);
        float at_near = below + ty * (over - below);
        below = far[lane] + tx * (far[lane + right] - far[lane]);
        over = far[lane + above] + tx * (far[lane + above + right] - far[lane + above]);
        float at_far = below + ty * (over - below);
        float light = at_near + tz * (at_far - at_near);
        lights.c[lane] = light < 0.0f ? 0.0f : light;
    }
    return lights;
"""


@wp.func_native(_TRILINEAR_LIGHTS)
def trilinear_lights(field: wp.array3d(dtype=Lanes), cell: wp.vec3) -> Lanes:
    """All lights at a position in cells, >= 0; straight on through the outer half of the outermost cells."""
    ...


@wp.struct
class Lights:
    """The light grid. to_lights: rows are the world vectors to right, top and front. to_cells: metres to cells.

    corner_m: of cell (0, 0, 0), from the grid's corner. optical_depth: from each cell to each light, [c, b, a].
    scattered: fluence of light that has scattered, in parts of the irradiance, in cells that are `scatter_cells` times
    as large; of size 0 if it is left out. samples: slabs of a ray, see `march_swept`.
    """

    to_lights: wp.mat33
    to_cells: wp.mat33
    corner_m: wp.vec3
    optical_depth: wp.array3d(dtype=Lanes)
    scattered: wp.array3d(dtype=Lanes)
    scatter_cells: int
    samples: int


@wp.func
def march_ray(volume: Volume, lights: Lights, step_m: float, offset: float, origin: wp.vec3, forward: wp.vec3):
    """Light scattered from each light, transmittance, depth [m] and emitted light along one ray."""
    seen = slab(origin - volume.seen_low, forward, volume.seen_high - volume.seen_low)
    steps = int(wp.ceil(wp.max(seen[1] - seen[0], 0.0) / step_m))
    steps_a_slab = wp.max((steps + lights.samples - 1) / lights.samples, 1)
    largest_slab = 1.0 / float(lights.samples)
    start = seen[0] + offset * step_m
    voxel = (origin + start * forward) / volume.voxel_m
    voxel_step = forward * (step_m / volume.voxel_m)
    steps_a_voxel = wp.vec3()
    for axis in range(3):
        steps_a_voxel[axis] = 1.0e6
        if wp.abs(voxel_step[axis]) > 1.0e-6:
            steps_a_voxel[axis] = 1.0 / voxel_step[axis]
    cell = lights.to_cells * (origin + start * forward - lights.corner_m)
    cell_step = lights.to_cells * (step_m * forward)
    if volume.to_solid.shape[0] > 0:
        steps = steps_to_wall(volume, voxel, voxel_step, steps_a_voxel, steps)

    lit = Lanes()
    glow = Lanes()
    emitted = float(0.0)
    thickness = volume.extinction_per_m * step_m  # optical depth of a step through density 1
    remaining = float(1.0)
    depth = float(wp.inf)
    weight = float(0.0)  # opacity that waits to be lit
    moment = float(0.0)  # the same times the number of its step
    slab_end = int(steps_a_slab)
    n = int(0)
    lane = int(LANES)  # of the eight steps sampled last; LANES if they are used up
    depths = Lanes()
    passed = Lanes()
    fire = Lanes()
    while n < steps and remaining > SMALLEST_TRANSMITTANCE:
        if lane == LANES:
            here = voxel + float(n) * voxel_step
            distance = blocks_to_nearest(volume.to_smoke, here)
            if distance > 0:
                n += steps_to_nearest(here, steps_a_voxel, distance)
            else:
                depths = thickness * trilinear_along(volume.density, here, voxel_step)
                passed = exp_minus(depths)
                if volume.emission.shape[0] > 0:
                    fire = trilinear_along(volume.emission, here, voxel_step)
                lane = 0
        if lane < LANES:
            if volume.emission.shape[0] > 0:
                emitted += remaining * emitted_along(fire[lane], step_m, depths[lane], passed[lane])
            if depths[lane] > thickness * volume.depth_threshold and depth > 1.0e30:
                depth = start + float(n) * step_m
            opacity = remaining * (1.0 - passed[lane])
            weight += opacity
            moment += opacity * float(n)
            remaining -= opacity
            lane += 1
            n += 1
        ends = n >= steps or remaining <= SMALLEST_TRANSMITTANCE
        if n >= slab_end or weight > largest_slab or ends:
            slab_end = n - n % steps_a_slab + steps_a_slab
            if weight > SMALLEST_SLAB or (ends and weight > 0.0):
                centre = cell + (moment / weight) * cell_step
                lit += weight * exp_minus(trilinear_lights(lights.optical_depth, centre))
                if lights.scattered.shape[0] > 0:
                    glow += weight * trilinear_lights(lights.scattered, centre / float(lights.scatter_cells))
                weight = 0.0
                moment = 0.0
    if remaining < 1.0:
        for axis in range(3):
            toward = wp.vec3(lights.to_lights[axis, 0], lights.to_lights[axis, 1], lights.to_lights[axis, 2])
            cosine = wp.dot(toward, forward)
            lit[2 * axis] = wp.pi * volume.albedo * henyey_greenstein(cosine, volume.hg_g) * lit[2 * axis]
            lit[2 * axis + 1] = wp.pi * volume.albedo * henyey_greenstein(-cosine, volume.hg_g) * lit[2 * axis + 1]
        lit += 0.25 * volume.albedo * glow  # what has scattered before comes from all sides: pi / (4 pi)
    return lit, remaining, depth, emitted


@wp.kernel
def march_swept(
    first_row: int,
    view: View,
    volume: Volume,
    step_m: float,
    jittered: int,
    seed: wp.uint32,
    rays_a_side: int,
    chosen: wp.array2d(dtype=wp.int8),
    lights: Lights,
    in_scatter: wp.array2d(dtype=Lanes),
    transmittance: wp.array2d(dtype=float),
    depth_m: wp.array2d(dtype=float),
    emissive: wp.array2d(dtype=float),
):
    """Density at every step, light once a slab of steps, where the slab's opacity has its centre of mass.

    A slab ends at 1 / samples of the ray's way through the smoke's box, or when it is that opaque. The mean of a
    square of rays, the nearest of their depths. chosen: 1 for pixels to march; of size 0 for all.
    """
    band_row, column = wp.tid()
    row = first_row + band_row
    if chosen.shape[0] > 0:
        if chosen[row, column] == wp.int8(0):
            return
    shift = float(0.5)
    if jittered == 1:
        shift = uniform_hash(seed, wp.uint32(row * view.width_px + column))
    lit = Lanes()
    remaining = float(0.0)
    depth = float(wp.inf)
    emitted = float(0.0)
    rays = rays_a_side * rays_a_side
    for ray in range(rays):
        origin, forward = camera_ray(view, image_point(view, row, column, ray, rays_a_side))
        offset = shift + float(jittered * ray) / float(rays)
        if offset >= 1.0:
            offset -= 1.0
        ray_lit, ray_remaining, ray_depth, ray_emitted = march_ray(volume, lights, step_m, offset, origin, forward)
        lit += ray_lit
        remaining += ray_remaining
        depth = wp.min(depth, ray_depth)
        emitted += ray_emitted
    in_scatter[row, column] = lit / float(rays)
    transmittance[row, column] = remaining / float(rays)
    depth_m[row, column] = depth
    if emissive.shape[0] > 0:
        emissive[row, column] = emitted / float(rays)
