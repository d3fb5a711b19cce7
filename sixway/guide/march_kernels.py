"""Warp kernel of the marched guide: one pixel a thread, arithmetic only. `oracle.py` says the same in NumPy."""

import warp as wp

from sixway.guide.ray_kernels import Lanes, View, camera_ray, henyey_greenstein, image_point, slab, uniform_hash
from sixway.guide.smoke_kernels import Volume, emitted_along

wp.set_module_options({"enable_backward": False})


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


SMALLEST_WEIGHT = wp.constant(1.0e-4)
"""A sample that could add less than this to the picture is not lit, and a ray with less left ends."""

LARGEST_OPTICAL_DEPTH = wp.constant(12.0)
"""Light that has passed this much smoke is gone."""


@wp.func
def march_ray(
    volume: Volume,
    extent_m: wp.vec3,
    smoke_low: wp.vec3,
    smoke_high: wp.vec3,
    to_light: wp.array(dtype=wp.vec3),
    literal_weight: int,
    step_m: float,
    offset: float,
    origin: wp.vec3,
    forward: wp.vec3,
):
    """Light scattered from each light, transmittance, depth [m] and emitted light along one ray.

    Samples stand where a march through the whole box, and the half voxel around it over which smoke fades out, would
    put them; those outside the smoke are left out.
    """
    lit = Lanes()
    emitted = float(0.0)
    remaining = float(1.0)  # T_{n-1}
    depth = float(wp.inf)
    fade = wp.vec3(0.5 * volume.voxel_m)
    first = slab(origin + fade, forward, extent_m + 2.0 * fade)[0] + offset * step_m
    seen = slab(origin - volume.seen_low, forward, volume.seen_high - volume.seen_low)
    n = wp.max(wp.ceil((seen[0] - first) / step_m), 0.0)
    t = first + n * step_m
    while t < seen[1] and remaining > SMALLEST_WEIGHT:
        x = origin + t * forward
        if volume.obstacle.shape[0] > 0:
            if trilinear(volume.obstacle, x / volume.obstacle_voxel_m) > 0.5:
                break
        rho = trilinear(volume.density, x / volume.voxel_m)
        sigma_t = volume.extinction_per_m * rho
        passed = wp.exp(-sigma_t * step_m)
        if volume.emission.shape[0] > 0:
            emission = trilinear(volume.emission, x / volume.voxel_m)
            emitted += remaining * emitted_along(emission, step_m, sigma_t * step_m, passed)
        if sigma_t > 0.0:
            if rho > volume.depth_threshold and depth > 1.0e30:
                depth = t
            weight = remaining * (1.0 - passed)
            if literal_weight == 1:
                weight = remaining * sigma_t
            if weight > SMALLEST_WEIGHT:
                for light in range(to_light.shape[0]):
                    toward = to_light[light]
                    exit_m = slab(x - smoke_low, toward, smoke_high - smoke_low)[1]
                    rho_sum = float(0.0)
                    s = float(0.5 * step_m)
                    while s < exit_m and rho_sum < LARGEST_OPTICAL_DEPTH / (volume.extinction_per_m * step_m):
                        rho_sum += trilinear(volume.density, (x + s * toward) / volume.voxel_m)
                        s += step_m
                    passed_light = wp.exp(-volume.extinction_per_m * step_m * rho_sum)
                    phase = henyey_greenstein(wp.dot(toward, forward), volume.hg_g)
                    lit[light] += wp.pi * volume.albedo * phase * weight * passed_light
            remaining *= passed
        n += 1.0
        t = first + n * step_m
    return lit, remaining, depth, emitted


@wp.kernel
def march_guide(
    first_row: int,
    view: View,
    volume: Volume,
    step_m: float,
    jittered: int,
    seed: wp.uint32,
    rays_a_side: int,
    chosen: wp.array2d(dtype=wp.int8),
    extent_m: wp.vec3,
    smoke_low: wp.vec3,
    smoke_high: wp.vec3,
    to_light: wp.array(dtype=wp.vec3),
    literal_weight: int,
    in_scatter: wp.array2d(dtype=Lanes),
    transmittance: wp.array2d(dtype=float),
    depth_m: wp.array2d(dtype=float),
    emissive: wp.array2d(dtype=float),
):
    """Algorithm 1 of the paper, one channel a light, the mean of a square of rays; nearest of their depths.

    chosen: 1 for pixels to march; of size 0 for all. Positions are relative to the grid's corner.
    """
    band_row, column = wp.tid()
    row = first_row + band_row
    if chosen.shape[0] > 0:
        if chosen[row, column] == wp.int8(0):
            return
    shift = float(0.0)
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
        ray_lit, ray_remaining, ray_depth, ray_emitted = march_ray(
            volume, extent_m, smoke_low, smoke_high, to_light, literal_weight, step_m, offset, origin, forward
        )
        lit += ray_lit
        remaining += ray_remaining
        depth = wp.min(depth, ray_depth)
        emitted += ray_emitted
    in_scatter[row, column] = lit / float(rays)
    transmittance[row, column] = remaining / float(rays)
    depth_m[row, column] = depth
    if emissive.shape[0] > 0:
        emissive[row, column] = emitted / float(rays)
