"""Warp kernel of the smoke's motion in the image: one pixel a thread. `oracle.py` says the same in NumPy."""

import warp as wp

from sixway.guide.ray_kernels import LANES, Lanes, View, camera_ray, exp_minus, image_point, slab, trilinear_along
from sixway.guide.smoke_kernels import Volume, blocks_to_nearest, steps_to_nearest, steps_to_wall

wp.set_module_options({"enable_backward": False})

SMALLEST_WEIGHT = wp.constant(1.0e-4)
"""Smoke that is less opaque than this has no motion."""


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


@wp.func
def image_speed(view: View, point: wp.vec2, x: wp.vec3, wind: wp.vec3) -> wp.vec2:
    """Speed [px/s; right, down] in the image of what moves with `wind` at x, seen at `point`."""
    along_u = wp.dot(wind, view.right_m) / wp.dot(view.right_m, view.right_m)
    along_v = wp.dot(wind, view.up_m) / wp.dot(view.up_m, view.up_m)
    if view.perspective == 1:
        # u = (x . right / |right|^2) distance / z, so du/dt has the change of z as well
        distance = wp.length(view.to_target_m)
        ahead = view.to_target_m / distance
        z = wp.dot(x - view.position_m, ahead)
        approach = wp.dot(wind, ahead)
        along_u = (along_u * distance - point[0] * approach) / z
        along_v = (along_v * distance - point[1] * approach) / z
    return wp.vec2(0.5 * along_u * float(view.width_px), -0.5 * along_v * float(view.height_px))


@wp.kernel
def march_motion(
    first_row: int,
    view: View,
    volume: Volume,
    velocity_m_s: wp.array3d(dtype=wp.vec3),
    velocity_voxel_m: float,
    frame_s: float,
    mean_px: wp.array2d(dtype=wp.vec2),
    variance_px2: wp.array2d(dtype=wp.vec2),
    alpha: wp.array2d(dtype=float),
):
    """Mean and variance of the motion along a ray, weighted by opacity, one sample a voxel (West 1979)."""
    band_row, column = wp.tid()
    row = first_row + band_row
    point = image_point(view, row, column, 0, 1)
    origin, forward = camera_ray(view, point)
    seen = slab(origin - volume.seen_low, forward, volume.seen_high - volume.seen_low)
    steps = int(wp.ceil(wp.max(seen[1] - seen[0], 0.0) / volume.voxel_m))
    start = seen[0] + 0.5 * volume.voxel_m
    voxel = (origin + start * forward) / volume.voxel_m
    steps_a_voxel = wp.vec3()
    for axis in range(3):
        steps_a_voxel[axis] = 1.0e6
        if wp.abs(forward[axis]) > 1.0e-6:
            steps_a_voxel[axis] = 1.0 / forward[axis]
    if volume.to_solid.shape[0] > 0:
        steps = steps_to_wall(volume, voxel, forward, steps_a_voxel, steps)
    thickness = volume.extinction_per_m * volume.voxel_m
    remaining = float(1.0)
    total = float(0.0)
    mean = wp.vec2()
    squares = wp.vec2()
    passed = Lanes()
    n = int(0)
    while n < steps and remaining > SMALLEST_WEIGHT:
        here = voxel + float(n) * forward
        distance = blocks_to_nearest(volume.to_smoke, here)
        if distance > 0:
            n += steps_to_nearest(here, steps_a_voxel, distance)
        else:
            passed = exp_minus(thickness * trilinear_along(volume.density, here, forward))
            for lane in range(wp.min(LANES, steps - n)):
                weight = remaining * (1.0 - passed[lane])
                if weight > 0.0:
                    x = (here + float(lane) * forward) * volume.voxel_m
                    wind = trilinear_vector(velocity_m_s, x / velocity_voxel_m)
                    motion = frame_s * image_speed(view, point, x, wind)
                    total += weight
                    away = motion - mean
                    mean += (weight / total) * away
                    squares += weight * wp.cw_mul(away, motion - mean)
                    remaining -= weight
            n += LANES
    if total > SMALLEST_WEIGHT:
        mean_px[row, column] = mean
        variance_px2[row, column] = squares / total
    else:
        mean_px[row, column] = wp.vec2()
        variance_px2[row, column] = wp.vec2()
    alpha[row, column] = 1.0 - remaining
