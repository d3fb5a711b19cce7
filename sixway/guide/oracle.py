"""The guide in NumPy float64: slow, plain, and independent of Warp. Tests hold the kernels to it."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.guide.config import GuideConfig
from sixway.guide.smoke import block_contents, smoke_boxes, support
from sixway.guide.sweep import LightGrid
from sixway.guide.views import to_light_in_world

SMALLEST_WEIGHT = 1e-4
SMALLEST_SLAB = 1e-3


def uniform_hash(seed: int, index: np.ndarray) -> np.ndarray:
    """`kernels.uniform_hash` on arrays of indices."""
    with np.errstate(over="ignore"):
        state = (index.astype(np.uint32) + np.uint32(seed) * np.uint32(2654435769)) * np.uint32(747796405)
        state = state + np.uint32(2891336453)
        word = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737)
        word = (word >> np.uint32(22)) ^ word
    return (word >> np.uint32(8)) / 16777216.0


def henyey_greenstein(cosine: np.ndarray, g: float) -> np.ndarray:
    """Phase function [1/sr] for the angle between incoming and outgoing travel."""
    return (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


def sample(density: np.ndarray, voxel: np.ndarray) -> np.ndarray:
    """Trilinear density at [..., 3] positions (x, y, z) in voxel units; empty outside the grid."""
    coordinates = np.moveaxis(voxel[..., ::-1] - 0.5, -1, 0)
    padded = np.pad(density, 1)  # a border of empty voxels, so that the edge fades as in the kernel
    return map_coordinates(padded, coordinates + 1.0, order=1, mode="constant", cval=0.0)


def slab(origin: np.ndarray, forward: np.ndarray, extent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances at which rays enter and leave the box [0, extent]."""
    safe = np.where(np.abs(forward) < 1e-8, 1e-30, forward)
    a, b = -origin / safe, (extent - origin) / safe
    return np.maximum(np.minimum(a, b).max(-1), 0.0), np.maximum(a, b).min(-1)


def march_guide(
    frame: DensityFrame, camera: Camera, medium: Medium, config: GuideConfig, *, seed: int
) -> tuple[Float[np.ndarray, "h w l"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """In-scatter a light (lightmap units), transmittance and depth_m, as `kernels.march_guide`."""
    density = box_average(frame.density.astype(np.float64), config.mip)
    size, step = frame.grid.voxel_size_m * config.mip, config.step_m(frame.grid)
    extent = np.array(frame.grid.extent_m)
    origin, forward = camera.rays()
    origin = origin - np.array(frame.grid.origin_m)
    to_light = [to_light_in_world(d, camera, config.vertical) for d in DIRECTIONS if d in config.lights]
    enter, leave = slab(origin, forward, extent)
    pixels = np.arange(enter.size).reshape(enter.shape)
    t = enter + (step * uniform_hash(seed, pixels) if config.jitter else 0.0)
    remaining = np.ones(enter.shape)
    depth = np.full(enter.shape, np.inf)
    in_scatter = np.zeros((*enter.shape, len(to_light)))
    threshold = 1e-3 * density.max()
    alive = t < leave
    while alive.any():
        x = origin + t[..., None] * forward
        if frame.obstacle is not None:
            alive &= sample(frame.obstacle, x / frame.grid.voxel_size_m) <= 0.5
        rho = np.where(alive, sample(density, x / size), 0.0)
        sigma_t = medium.extinction_per_m * rho
        depth = np.where((rho > threshold) & np.isinf(depth), t, depth)
        passed = np.exp(-sigma_t * step)
        weight = remaining * (sigma_t if config.weight == "paper_literal" else 1.0 - passed)
        for light, toward in enumerate(to_light):
            toward_array = np.broadcast_to(np.array(toward), x.shape)
            exit_m = slab(x, toward_array, extent)[1]
            optical_depth = np.zeros(t.shape)
            s = 0.5 * step
            while (s < exit_m[alive]).any():
                sigma = medium.extinction_per_m * sample(density, (x + s * toward_array) / size)
                optical_depth += np.where(s < exit_m, sigma * step, 0.0)
                s += step
            phase = henyey_greenstein((toward_array * forward).sum(-1), medium.hg_g)
            lit = np.where(weight > SMALLEST_WEIGHT, weight, 0.0)
            in_scatter[..., light] += np.pi * medium.albedo * phase * lit * np.exp(-optical_depth)
        remaining = remaining * passed
        t = t + step
        alive &= t < leave
    return in_scatter, remaining, depth


def march_swept(
    frame: DensityFrame, camera: Camera, medium: Medium, config: GuideConfig, *, seed: int
) -> tuple[Float[np.ndarray, "h w l"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """The same by coarse sweeps, as `sweep.sweep_lit`; the light grid stands where the kernels' does."""
    extinction = medium.extinction_per_m
    size, step = frame.grid.voxel_size_m * config.mip, config.step_m(frame.grid)
    density = box_average(frame.density.astype(np.float64), config.mip)
    box = support(density, above=0.0)
    assert box is not None
    box = box[0], np.minimum(box[1], np.array(frame.density.shape[::-1]) / config.mip)
    seen_low, seen_high = box[0] * size, box[1] * size
    if frame.obstacle is not None and (walls := support(frame.obstacle, above=0.0)) is not None:
        seen_low = np.minimum(seen_low, walls[0] * frame.grid.voxel_size_m)
        seen_high = np.maximum(seen_high, walls[1] * frame.grid.voxel_size_m)
    lights = LightGrid.around(smoke_boxes(block_contents(density, 0.0, None, 1), box) * size, camera, config)
    cells = light_cells(density, size, lights)
    optical_depth = extinction * lights.cell_m * light_sums(cells)
    coarse = extinction * lights.cell_m * 2.0 * box_average(cells, 2)
    scattered = scatter(coarse, albedo=medium.albedo, iterations=config.scatter_iterations)

    origin, forward = camera.rays()
    origin = origin - np.array(frame.grid.origin_m)
    enter, leave = slab(origin - seen_low, forward, seen_high - seen_low)
    steps = np.ceil(np.maximum(leave - enter, 0.0) / step).astype(int)
    steps_a_slab = np.maximum(-(-steps // config.light_samples), 1)
    offset = uniform_hash(seed, np.arange(enter.size).reshape(enter.shape)) if config.jitter else 0.5
    start = enter + offset * step
    remaining, depth = np.ones(enter.shape), np.full(enter.shape, np.inf)
    weight, moment = np.zeros(enter.shape), np.zeros(enter.shape)
    lit, glow = np.zeros((*enter.shape, 6)), np.zeros((*enter.shape, 6))
    blocked = np.zeros(enter.shape, bool)
    for n in range(steps.max() + 1):
        x = origin + (start + n * step)[..., None] * forward
        alive = (n < steps) & (remaining > SMALLEST_WEIGHT) & ~blocked
        if frame.obstacle is not None:
            blocked |= alive & (sample(frame.obstacle, x / frame.grid.voxel_size_m) > 0.5)
            alive &= ~blocked
        rho = np.where(alive, sample(density, x / size), 0.0)
        depth = np.where((rho > 1e-3 * density.max()) & np.isinf(depth), start + n * step, depth)
        opacity = remaining * (1.0 - np.exp(-extinction * step * rho))
        weight, moment, remaining = weight + opacity, moment + opacity * n, remaining - opacity
        slab_ends = ((n + 1) % steps_a_slab == 0) | (weight > 1.0 / config.light_samples)
        light_now = np.where(alive, slab_ends & (weight > SMALLEST_SLAB), weight > 0.0)
        centre = start + moment / np.maximum(weight, 1e-30) * step
        cell = (origin + centre[..., None] * forward - lights.corner_m) @ np.linalg.inv(lights.axes * lights.cell_m).T
        passed = np.exp(-np.maximum(interpolate_lights(optical_depth, cell), 0.0))
        lit += np.where(light_now, weight, 0.0)[..., None] * passed
        glow += np.where(light_now, weight, 0.0)[..., None] * interpolate_lights(scattered, 0.5 * cell)
        weight, moment = np.where(light_now, 0.0, weight), np.where(light_now, 0.0, moment)
    for index, name in enumerate(DIRECTIONS):
        cosine = forward @ np.array(to_light_in_world(name, camera, config.vertical))
        lit[..., index] *= np.pi * medium.albedo * henyey_greenstein(cosine, medium.hg_g)
    lit += 0.25 * medium.albedo * np.maximum(glow, 0.0)
    return lit[..., [DIRECTIONS.index(name) for name in config.light_names]], remaining, depth


def box_average(field: np.ndarray, edge: int) -> np.ndarray:
    """Means over boxes of edge^3 voxels; voxels that the last boxes lack count as empty."""
    padded = np.pad(field, [(0, -n % edge) for n in field.shape])
    z, y, x = (n // edge for n in padded.shape)
    return padded.reshape(z, edge, y, edge, x, edge).mean(axis=(1, 3, 5))


def light_cells(density: np.ndarray, size: float, lights: LightGrid) -> Float[np.ndarray, "c b a"]:
    """Density at the centres of the light grid's cells."""
    blur = lights.blur_voxels(size)
    index = np.moveaxis(np.indices(lights.shape[::-1])[::-1], 0, -1)
    centres = lights.corner_m + (index + 0.5) * lights.cell_m @ lights.axes.T
    return sample(box_average(density, blur), centres / (size * blur))


def light_sums(cells: Float[np.ndarray, "c b a"]) -> Float[np.ndarray, "c b a 6"]:
    """Cells added up from every cell's centre to each light."""
    pairs = []
    for axis in (2, 1, 0):
        before = cells.cumsum(axis) - 0.5 * cells
        pairs += [cells.sum(axis, keepdims=True) - before, before]
    return np.stack(pairs, axis=-1)


def scatter(thickness: Float[np.ndarray, "c b a"], *, albedo: float, iterations: int) -> Float[np.ndarray, "c b a 6"]:
    """Fluence of scattered light by discrete ordinates; thickness: optical depth across each cell."""
    direct = np.exp(-light_sums(thickness))
    scattered = np.zeros_like(direct)
    for _ in range(iterations):
        gathered = np.zeros_like(direct)
        for axis in range(3):
            for way in (slice(None), slice(None, None, -1)):
                half = np.exp(-0.5 * np.moveaxis(thickness, axis, 0)[way])[..., None]
                source = np.moveaxis(direct + scattered, axis, 0)[way]
                middle = np.zeros_like(source)
                arriving = np.zeros_like(source[0])
                for n in range(len(source)):
                    middle[n] = arriving * half[n] + source[n] * (1.0 - half[n])
                    arriving = middle[n] * half[n] + source[n] * (1.0 - half[n])
                gathered += albedo / 6.0 * np.moveaxis(middle[way], 0, axis)
        scattered = gathered
    return scattered


def interpolate_lights(field: Float[np.ndarray, "c b a 6"], cell: np.ndarray) -> np.ndarray:
    """`sweep_kernels.trilinear_lights` at [..., 3] positions in cells: extrapolated for half a cell at the border."""
    limit = np.array(field.shape[2::-1]) - 2
    low = np.clip(np.floor(cell - 0.5).astype(int), 0, limit)
    part = np.clip(cell - 0.5 - low, -0.5, 1.5)
    total = np.zeros((*cell.shape[:-1], 6))
    for corner in np.ndindex(2, 2, 2):
        share = np.prod(np.where(corner, part, 1.0 - part), axis=-1)
        i, j, k = np.moveaxis(low + corner, -1, 0)
        total += share[..., None] * field[k, j, i]
    return total
