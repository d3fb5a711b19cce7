"""The guide in NumPy float64: slow, plain, and independent of Warp. Tests hold the kernels to it."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.guide.march import GuideConfig, to_light_in_world

SMALLEST_WEIGHT = 1e-4


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
    density = frame.density.astype(np.float64)
    size, step = frame.grid.voxel_size_m, config.step_m(frame.grid)
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
            alive &= sample(frame.obstacle, x / size) <= 0.5
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
