"""Warp kernels of the guide: one ray a thread, arithmetic only. `oracle.py` says the same in NumPy."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def uniform_hash(seed: wp.uint32, index: wp.uint32) -> float:
    """A number in [0, 1) from two integers: PCG-RXS-M-XS (Jarzynski and Olano 2020, `pcg`)."""
    state = (index + seed * wp.uint32(2654435769)) * wp.uint32(747796405) + wp.uint32(2891336453)
    word = ((state >> ((state >> wp.uint32(28)) + wp.uint32(4))) ^ state) * wp.uint32(277803737)
    word = (word >> wp.uint32(22)) ^ word
    return float(word >> wp.uint32(8)) * (1.0 / 16777216.0)


@wp.func
def voxel_or_zero(field: wp.array3d(dtype=float), k: int, j: int, i: int) -> float:
    if k < 0 or j < 0 or i < 0 or k >= field.shape[0] or j >= field.shape[1] or i >= field.shape[2]:
        return 0.0
    return field[k, j, i]


@wp.func
def trilinear(field: wp.array3d(dtype=float), voxel: wp.vec3) -> float:
    """The field at a position in voxel units (voxel 0 is centred at 0.5); empty outside the grid."""
    x = voxel[0] - 0.5
    y = voxel[1] - 0.5
    z = voxel[2] - 0.5
    fi = wp.floor(x)
    fj = wp.floor(y)
    fk = wp.floor(z)
    i = int(fi)
    j = int(fj)
    k = int(fk)
    tx = x - fi
    ty = y - fj
    tz = z - fk
    inside = i >= 0 and j >= 0 and k >= 0
    if inside and i + 1 < field.shape[2] and j + 1 < field.shape[1] and k + 1 < field.shape[0]:
        return wp.lerp(
            wp.lerp(
                wp.lerp(field[k, j, i], field[k, j, i + 1], tx),
                wp.lerp(field[k, j + 1, i], field[k, j + 1, i + 1], tx),
                ty,
            ),
            wp.lerp(
                wp.lerp(field[k + 1, j, i], field[k + 1, j, i + 1], tx),
                wp.lerp(field[k + 1, j + 1, i], field[k + 1, j + 1, i + 1], tx),
                ty,
            ),
            tz,
        )
    near = wp.lerp(
        wp.lerp(voxel_or_zero(field, k, j, i), voxel_or_zero(field, k, j, i + 1), tx),
        wp.lerp(voxel_or_zero(field, k, j + 1, i), voxel_or_zero(field, k, j + 1, i + 1), tx),
        ty,
    )
    far = wp.lerp(
        wp.lerp(voxel_or_zero(field, k + 1, j, i), voxel_or_zero(field, k + 1, j, i + 1), tx),
        wp.lerp(voxel_or_zero(field, k + 1, j + 1, i), voxel_or_zero(field, k + 1, j + 1, i + 1), tx),
        ty,
    )
    return wp.lerp(near, far, tz)


@wp.func
def slab(origin: wp.vec3, forward: wp.vec3, extent: wp.vec3) -> wp.vec2:
    """Distances at which a ray enters and leaves the box [0, extent]; enters > leaves on a miss."""
    t_near = float(0.0)
    t_far = float(1.0e30)
    for axis in range(3):
        if wp.abs(forward[axis]) < 1.0e-8:
            if origin[axis] < 0.0 or origin[axis] > extent[axis]:
                t_far = float(-1.0)
        else:
            a = -origin[axis] / forward[axis]
            b = (extent[axis] - origin[axis]) / forward[axis]
            t_near = wp.max(t_near, wp.min(a, b))
            t_far = wp.min(t_far, wp.max(a, b))
    return wp.vec2(t_near, t_far)


@wp.func
def henyey_greenstein(cosine: float, g: float) -> float:
    """Phase function [1/sr] for the angle between incoming and outgoing travel."""
    base = 1.0 + g * g - 2.0 * g * cosine
    return (1.0 - g * g) / (4.0 * wp.pi * base * wp.sqrt(base))


@wp.func
def ray_origin(
    row: int, column: int, shape: wp.vec2, position: wp.vec3, right: wp.vec3, up: wp.vec3, perspective: int
) -> wp.vec3:
    """right and up are scaled to half the image's width and height at the target."""
    if perspective == 1:
        return position
    u = (float(column) + 0.5) / shape[1] * 2.0 - 1.0
    v = 1.0 - (float(row) + 0.5) / shape[0] * 2.0
    return position + u * right + v * up


@wp.func
def ray_forward(
    row: int, column: int, shape: wp.vec2, to_target: wp.vec3, right: wp.vec3, up: wp.vec3, perspective: int
) -> wp.vec3:
    """to_target runs from the camera to its target, in metres."""
    if perspective == 0:
        return wp.normalize(to_target)
    u = (float(column) + 0.5) / shape[1] * 2.0 - 1.0
    v = 1.0 - (float(row) + 0.5) / shape[0] * 2.0
    return wp.normalize(u * right + v * up + to_target)


SMALLEST_WEIGHT = wp.constant(1.0e-4)
"""A sample that could add less than this to the picture is not lit, and a ray with less left ends."""

LARGEST_OPTICAL_DEPTH = wp.constant(12.0)
"""Light that has passed this much smoke is gone."""


@wp.kernel
def march_guide(
    first_row: int,
    density: wp.array3d(dtype=float),
    voxel_m: float,
    obstacle: wp.array3d(dtype=float),
    obstacle_voxel_m: float,
    extent_m: wp.vec3,
    smoke_low: wp.vec3,
    smoke_high: wp.vec3,
    seen_low: wp.vec3,
    seen_high: wp.vec3,
    position_m: wp.vec3,
    to_target: wp.vec3,
    right: wp.vec3,
    up: wp.vec3,
    perspective: int,
    to_light: wp.array(dtype=wp.vec3),
    extinction_per_m: float,
    albedo: float,
    hg_g: float,
    step_m: float,
    depth_threshold: float,
    literal_weight: int,
    jittered: int,
    seed: wp.uint32,
    in_scatter: wp.array3d(dtype=float),
    transmittance: wp.array2d(dtype=float),
    depth_m: wp.array2d(dtype=float),
):
    """Algorithm 1 of the paper, one channel a light. Positions are relative to the grid's corner.

    Samples stand where a march through the whole box would put them; those outside the smoke are left out.
    """
    band_row, column = wp.tid()
    row = first_row + band_row
    shape = wp.vec2(float(transmittance.shape[0]), float(transmittance.shape[1]))
    origin = ray_origin(row, column, shape, position_m, right, up, perspective)
    forward = ray_forward(row, column, shape, to_target, right, up, perspective)
    for light in range(to_light.shape[0]):
        in_scatter[row, column, light] = 0.0
    remaining = float(1.0)  # T_{n-1}
    depth = float(wp.inf)
    first = slab(origin, forward, extent_m)[0]
    if jittered == 1:
        first += step_m * uniform_hash(seed, wp.uint32(row * transmittance.shape[1] + column))
    seen = slab(origin - seen_low, forward, seen_high - seen_low)
    n = wp.max(wp.ceil((seen[0] - first) / step_m), 0.0)
    t = first + n * step_m
    while t < seen[1] and remaining > SMALLEST_WEIGHT:
        x = origin + t * forward
        if obstacle.shape[0] > 0:
            if trilinear(obstacle, x / obstacle_voxel_m) > 0.5:
                break
        rho = trilinear(density, x / voxel_m)
        sigma_t = extinction_per_m * rho
        if sigma_t > 0.0:
            if rho > depth_threshold and depth > 1.0e30:
                depth = t
            passed = wp.exp(-sigma_t * step_m)
            weight = remaining * (1.0 - passed)
            if literal_weight == 1:
                weight = remaining * sigma_t
            if weight > SMALLEST_WEIGHT:
                for light in range(to_light.shape[0]):
                    toward = to_light[light]
                    exit_m = slab(x - smoke_low, toward, smoke_high - smoke_low)[1]
                    rho_sum = float(0.0)
                    s = float(0.5 * step_m)
                    while s < exit_m and rho_sum < LARGEST_OPTICAL_DEPTH / (extinction_per_m * step_m):
                        rho_sum += trilinear(density, (x + s * toward) / voxel_m)
                        s += step_m
                    passed_light = wp.exp(-extinction_per_m * step_m * rho_sum)
                    phase = henyey_greenstein(wp.dot(toward, forward), hg_g)
                    in_scatter[row, column, light] += wp.pi * albedo * phase * weight * passed_light
            remaining *= passed
        n += 1.0
        t = first + n * step_m
    transmittance[row, column] = remaining
    depth_m[row, column] = depth


@wp.func
def trilinear_vector(field: wp.array3d(dtype=wp.vec3), voxel: wp.vec3) -> wp.vec3:
    """A vector field at a position in its own voxel units, held at the border."""
    x = wp.clamp(voxel[0] - 0.5, 0.0, float(field.shape[2] - 1))
    y = wp.clamp(voxel[1] - 0.5, 0.0, float(field.shape[1] - 1))
    z = wp.clamp(voxel[2] - 0.5, 0.0, float(field.shape[0] - 1))
    i = wp.min(int(x), wp.max(field.shape[2] - 2, 0))
    j = wp.min(int(y), wp.max(field.shape[1] - 2, 0))
    k = wp.min(int(z), wp.max(field.shape[0] - 2, 0))
    i1 = wp.min(i + 1, field.shape[2] - 1)
    j1 = wp.min(j + 1, field.shape[1] - 1)
    k1 = wp.min(k + 1, field.shape[0] - 1)
    tx = x - float(i)
    ty = y - float(j)
    tz = z - float(k)
    near = wp.lerp(wp.lerp(field[k, j, i], field[k, j, i1], tx), wp.lerp(field[k, j1, i], field[k, j1, i1], tx), ty)
    far = wp.lerp(wp.lerp(field[k1, j, i], field[k1, j, i1], tx), wp.lerp(field[k1, j1, i], field[k1, j1, i1], tx), ty)
    return wp.lerp(near, far, tz)


@wp.kernel
def march_motion(
    density: wp.array3d(dtype=float),
    velocity_m_s: wp.array3d(dtype=wp.vec3),
    velocity_voxel_m: float,
    voxel_size_m: float,
    extent_m: wp.vec3,
    position_m: wp.vec3,
    to_target: wp.vec3,
    right: wp.vec3,
    up: wp.vec3,
    perspective: int,
    extinction_per_m: float,
    step_m: float,
    frame_s: float,
    flow_px: wp.array3d(dtype=float),
):
    """Opacity-weighted motion of the smoke in the image, [px/frame; right, down]."""
    row, column = wp.tid()
    shape = wp.vec2(float(flow_px.shape[0]), float(flow_px.shape[1]))
    origin = ray_origin(row, column, shape, position_m, right, up, perspective)
    forward = ray_forward(row, column, shape, to_target, right, up, perspective)
    span = slab(origin, forward, extent_m)
    u = (float(column) + 0.5) / shape[1] * 2.0 - 1.0
    v = 1.0 - (float(row) + 0.5) / shape[0] * 2.0
    distance = wp.length(to_target)
    ahead = to_target / distance
    remaining = float(1.0)
    total = float(0.0)
    moved_u = float(0.0)
    moved_v = float(0.0)
    t = float(span[0] + 0.5 * step_m)
    while t < span[1]:
        x = origin + t * forward
        sigma_t = extinction_per_m * trilinear(density, x / voxel_size_m)
        passed = wp.exp(-sigma_t * step_m)
        weight = remaining * (1.0 - passed)
        wind = trilinear_vector(velocity_m_s, x / velocity_voxel_m)
        along_u = wp.dot(wind, right) / wp.dot(right, right)
        along_v = wp.dot(wind, up) / wp.dot(up, up)
        if perspective == 1:
            # u = (x . right / |right|^2) * distance / z, so du/dt has the change of z as well
            z = wp.dot(x - position_m, ahead)
            approach = wp.dot(wind, ahead)
            along_u = along_u * distance / z - u * approach / z
            along_v = along_v * distance / z - v * approach / z
        moved_u += weight * along_u
        moved_v += weight * along_v
        total += weight
        remaining *= passed
        t += step_m
    if total > 1.0e-4:
        flow_px[row, column, 0] = moved_u / total * frame_s * 0.5 * shape[1]
        flow_px[row, column, 1] = -moved_v / total * frame_s * 0.5 * shape[0]
    else:
        flow_px[row, column, 0] = 0.0
        flow_px[row, column, 1] = 0.0
