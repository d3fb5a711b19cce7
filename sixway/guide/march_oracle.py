"""The guide's marches in NumPy float64: slow, plain, and independent of Warp. Tests hold the kernels to them."""

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.guide.config import GuideConfig
from sixway.guide.oracle import Fields, henyey_greenstein, sample, slab, uniform_hash
from sixway.guide.sweep import LightGrid
from sixway.guide.sweep_oracle import interpolate_lights, light_cells, light_sums, lit_blocks, scatter
from sixway.guide.views import to_light_in_world

SMALLEST_WEIGHT = 1e-4
SMALLEST_SLAB = 1e-3
LARGEST_DIFFERENCE = 0.02

Pictures = tuple[
    Float[np.ndarray, "h w l"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]
]
"""In-scatter a light (lightmap units), transmittance, depth_m and emitted light."""


def march(frame: DensityFrame, camera: Camera, medium: Medium, config: GuideConfig, *, seed: int) -> Pictures:
    """What `GuideMarcher.march` puts together, lights apart."""
    march_rays = _swept_rays if config.lighting == "sweep" else _marched_rays
    fields = Fields.of(frame, medium, config)
    pixels = np.arange(camera.height_px * camera.width_px).reshape(camera.height_px, camera.width_px)
    shift = uniform_hash(seed, pixels) if config.jitter else np.zeros(pixels.shape)

    def mean_of(rays_a_side: int) -> Pictures:
        fine = camera.resized(camera.width_px * rays_a_side, camera.height_px * rays_a_side)
        origin, forward = fine.rays()
        origin = origin - np.array(frame.grid.origin_m)
        rays = rays_a_side**2
        number = np.arange(rays).reshape(rays_a_side, rays_a_side) * float(config.jitter)
        offset = (np.kron(shift, np.ones((rays_a_side, rays_a_side))) + np.tile(number / rays, pixels.shape)) % 1.0
        lit, transmittance, depth, emitted = march_rays(fields, frame, camera, medium, config, origin, forward, offset)

        def squares(field: np.ndarray) -> np.ndarray:
            return field.reshape(camera.height_px, rays_a_side, camera.width_px, rays_a_side, *field.shape[2:])

        means = (squares(field).mean(axis=(1, 3)) for field in (lit, transmittance, emitted))
        lit, transmittance, emitted = means
        return lit, transmittance, squares(depth).min(axis=(1, 3)), emitted

    once = mean_of(1)
    if config.pixel_samples == 1:
        return once
    around = np.pad(once[1], 1, mode="edge")
    near = [around[j : j + camera.height_px, i : i + camera.width_px] for j in range(3) for i in range(3)]
    edge = np.max(near, axis=0) - np.min(near, axis=0) > LARGEST_DIFFERENCE
    finer = mean_of(config.rays_a_side(camera, frame.grid))
    lit = np.where(edge[..., None], finer[0], once[0])
    transmittance, depth, emitted = (np.where(edge, finer[n], once[n]) for n in (1, 2, 3))
    return lit, transmittance, depth, emitted


def _marched_rays(
    fields: Fields,
    frame: DensityFrame,
    camera: Camera,
    medium: Medium,
    config: GuideConfig,
    origin: np.ndarray,
    forward: np.ndarray,
    offset: np.ndarray,
) -> Pictures:
    """`march_kernels.march_ray` on arrays of rays [h, w, 3]."""
    size, step = fields.voxel_m, config.step_m(frame.grid)
    fade = 0.5 * size  # smoke fades out over half a voxel around the box
    extent = np.array(frame.grid.extent_m) + 2.0 * fade
    to_light = [to_light_in_world(d, camera, config.vertical) for d in DIRECTIONS if d in config.lights]
    enter, leave = slab(origin + fade, forward, extent)
    t = enter + step * offset
    remaining = np.ones(enter.shape)
    depth = np.full(enter.shape, np.inf)
    in_scatter, emitted = np.zeros((*enter.shape, len(to_light))), np.zeros(enter.shape)
    threshold = 1e-3 * fields.density.max()
    alive = t < leave
    while alive.any():
        x = origin + t[..., None] * forward
        alive &= ~fields.blocked(x)
        rho = np.where(alive, sample(fields.density, x / size), 0.0)
        sigma_t = medium.extinction_per_m * rho
        depth = np.where((rho > threshold) & np.isinf(depth), t, depth)
        emitted += np.where(alive, remaining * fields.emitted(x, sigma_t * step, step), 0.0)
        passed = np.exp(-sigma_t * step)
        weight = remaining * (sigma_t if config.weight == "paper_literal" else 1.0 - passed)
        for light, toward in enumerate(to_light):
            toward_array = np.broadcast_to(np.array(toward), x.shape)
            exit_m = slab(x + fade, toward_array, extent)[1]
            optical_depth = np.zeros(t.shape)
            s = 0.5 * step
            while (s < exit_m[alive]).any():
                sigma = medium.extinction_per_m * sample(fields.density, (x + s * toward_array) / size)
                optical_depth += np.where(s < exit_m, sigma * step, 0.0)
                s += step
            phase = henyey_greenstein((toward_array * forward).sum(-1), medium.hg_g)
            lit = np.where(weight > SMALLEST_WEIGHT, weight, 0.0)
            in_scatter[..., light] += np.pi * medium.grey_albedo * phase * lit * np.exp(-optical_depth)
        remaining = remaining * passed
        t = t + step
        alive &= t < leave
    return in_scatter, remaining, depth, emitted


def _swept_rays(
    fields: Fields,
    frame: DensityFrame,
    camera: Camera,
    medium: Medium,
    config: GuideConfig,
    origin: np.ndarray,
    forward: np.ndarray,
    offset: np.ndarray,
) -> Pictures:
    """`swept_march_kernels.march_ray` on arrays of rays [h, w, 3]; the light grid stands where the kernels' does."""
    extinction, size, step = medium.extinction_per_m, fields.voxel_m, config.step_m(frame.grid)
    lights = LightGrid.around(fields.boxes, camera, frame.grid, config)
    cells = light_cells(fields.density, size, lights)
    optical_depth = extinction * lights.cell_m * light_sums(cells)
    density, direct = lit_blocks(cells, optical_depth, config.scatter_cells)
    thickness = extinction * lights.cell_m * config.scatter_cells * density
    scattered = scatter(
        direct, thickness, albedo=medium.grey_albedo, hg_g=medium.hg_g, iterations=config.scatter_iterations
    )

    enter, leave = slab(origin - fields.seen_low, forward, fields.seen_high - fields.seen_low)
    steps = np.ceil(np.maximum(leave - enter, 0.0) / step).astype(int)
    steps_a_slab = np.maximum(-(-steps // config.light_samples), 1)
    start = enter + (offset if config.jitter else 0.5) * step
    remaining, depth = np.ones(enter.shape), np.full(enter.shape, np.inf)
    weight, moment = np.zeros(enter.shape), np.zeros(enter.shape)
    lit, glow, emitted = np.zeros((*enter.shape, 6)), np.zeros((*enter.shape, 6)), np.zeros(enter.shape)
    blocked = np.zeros(enter.shape, bool)
    for n in range(steps.max() + 1):
        x = origin + (start + n * step)[..., None] * forward
        alive = (n < steps) & (remaining > SMALLEST_WEIGHT) & ~blocked
        blocked |= alive & fields.blocked(x)
        alive &= ~blocked
        rho = np.where(alive, sample(fields.density, x / size), 0.0)
        depth = np.where((rho > 1e-3 * fields.density.max()) & np.isinf(depth), start + n * step, depth)
        emitted += np.where(alive, remaining * fields.emitted(x, extinction * step * rho, step), 0.0)
        opacity = remaining * (1.0 - np.exp(-extinction * step * rho))
        weight, moment, remaining = weight + opacity, moment + opacity * n, remaining - opacity
        slab_ends = ((n + 1) % steps_a_slab == 0) | (weight > 1.0 / config.light_samples)
        light_now = np.where(alive, slab_ends & (weight > SMALLEST_SLAB), weight > 0.0)
        centre = start + moment / np.maximum(weight, 1e-30) * step
        cell = (origin + centre[..., None] * forward - lights.corner_m) @ np.linalg.inv(lights.axes * lights.cell_m).T
        passed = np.exp(-np.maximum(interpolate_lights(optical_depth, cell), 0.0))
        lit += np.where(light_now, weight, 0.0)[..., None] * passed
        glow += np.where(light_now, weight, 0.0)[..., None] * np.maximum(
            interpolate_lights(scattered, cell / config.scatter_cells), 0.0
        )
        weight, moment = np.where(light_now, 0.0, weight), np.where(light_now, 0.0, moment)
    for index, name in enumerate(DIRECTIONS):
        cosine = forward @ np.array(to_light_in_world(name, camera, config.vertical))
        lit[..., index] *= np.pi * medium.grey_albedo * henyey_greenstein(cosine, medium.hg_g)
    lit += 0.25 * medium.grey_albedo * glow
    chosen = [DIRECTIONS.index(name) for name in config.light_names]
    return lit[..., chosen], remaining, depth, emitted
