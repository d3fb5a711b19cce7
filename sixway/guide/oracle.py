"""What rays meet, in NumPy float64: slow, plain, and independent of Warp. Tests hold the kernels to it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.guide.config import GuideConfig
from sixway.guide.smoke import block_boxes, box_around

BLOCK = 4


def uniform_hash(seed: int, index: np.ndarray) -> np.ndarray:
    """`ray_kernels.uniform_hash` on arrays of indices."""
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


@dataclass(frozen=True)
class Fields:
    """A frame as the marches see it: averaged over boxes of voxels, in metres from the grid's corner."""

    density: np.ndarray
    emission: np.ndarray | None
    obstacle: np.ndarray | None
    voxel_m: float
    obstacle_voxel_m: float
    boxes: np.ndarray
    seen_low: np.ndarray
    seen_high: np.ndarray

    @classmethod
    def of(cls, frame: DensityFrame, medium: Medium, config: GuideConfig) -> "Fields":
        voxel_m = frame.grid.voxel_size_m * config.mip
        density = box_average(frame.density.astype(np.float64), config.mip)
        emission = None
        if config.emission and frame.emission is not None:
            emission = box_average(frame.emission.astype(np.float64), config.mip)
        full = block_peaks(density, BLOCK) > 1e-6 / (medium.extinction_per_m * frame.grid.voxel_size_m)
        if emission is not None:
            peaks = block_peaks(emission, BLOCK)
            full |= peaks > 1e-6 * peaks.max()
        boxes = seen = block_boxes(full, voxel_m, frame.grid)
        if frame.obstacle is not None:
            walls = block_peaks(frame.obstacle, BLOCK * config.mip) > 0.0
            seen = np.concatenate([boxes, block_boxes(walls, voxel_m, frame.grid)])
        seen_low, seen_high = box_around(seen)
        return cls(
            density=density,
            emission=emission,
            obstacle=frame.obstacle,
            voxel_m=voxel_m,
            obstacle_voxel_m=frame.grid.voxel_size_m,
            boxes=boxes,
            seen_low=seen_low,
            seen_high=seen_high,
        )

    def blocked(self, x: np.ndarray) -> np.ndarray:
        if self.obstacle is None:
            return np.zeros(x.shape[:-1], bool)
        return sample(self.obstacle, x / self.obstacle_voxel_m) > 0.5

    def emitted(self, x: np.ndarray, optical_depth: np.ndarray, step: float) -> np.ndarray:
        """Light that a step adds: eps h (1 - exp(-tau)) / tau."""
        if self.emission is None:
            return np.zeros(x.shape[:-1])
        safe = np.maximum(optical_depth, 1e-12)
        part = np.where(optical_depth > 1e-12, -np.expm1(-safe) / safe, 1.0)
        return sample(self.emission, x / self.voxel_m) * step * part


def block_peaks(field: np.ndarray, edge: int) -> np.ndarray:
    """Bounds on the interpolated field in every block of edge^3 voxels: it reaches one voxel beyond."""
    for _ in range(3):
        starts = range(0, len(field), edge)
        peaks = np.stack([field[max(start - 1, 0) : start + edge + 1].max(axis=0) for start in starts])
        field = np.moveaxis(peaks, 0, -1)
    return field


def box_average(field: np.ndarray, edge: int) -> np.ndarray:
    """Means over boxes of edge^3 voxels; voxels that the last boxes lack count as empty."""
    padded = np.pad(field, [(0, -n % edge) for n in field.shape])
    z, y, x = (n // edge for n in padded.shape)
    return padded.reshape(z, edge, y, edge, x, edge).mean(axis=(1, 3, 5))


def image_motion(
    frame: DensityFrame, camera: Camera, medium: Medium, *, frame_s: float
) -> tuple[Float[np.ndarray, "h w 2"], Float[np.ndarray, "h w 2"], Float[np.ndarray, "h w"]]:
    """Mean and variance of the motion along each ray and its opacity, as `motion.project_motion_statistics`."""
    assert frame.velocity_m_s is not None
    fields = Fields.of(frame, medium, GuideConfig())
    step, size = frame.grid.voxel_size_m, np.array([camera.width_px, camera.height_px])
    origin, forward = camera.rays()
    local = origin - np.array(frame.grid.origin_m)
    enter, leave = slab(local - fields.seen_low, forward, fields.seen_high - fields.seen_low)
    coarse = frame.grid.extent_m[0] / frame.velocity_m_s.shape[2]
    axes = np.array([camera.right, -np.array(camera.up)])  # right, down
    remaining, clear = np.ones(enter.shape), np.ones(enter.shape, bool)
    weights, motions = [], []
    for n in range(int(np.ceil((leave - enter).max() / step))):
        t = enter + (n + 0.5) * step
        x = local + t[..., None] * forward
        clear &= (n < np.ceil((leave - enter) / step)) & ~fields.blocked(x)
        weight = np.where(
            clear, remaining * -np.expm1(-medium.extinction_per_m * step * sample(fields.density, x / step)), 0.0
        )
        remaining = remaining - weight
        held = np.clip(x / coarse - 0.5, 0.0, np.array(frame.velocity_m_s.shape[2::-1]) - 1.0)[..., ::-1]
        wind = np.stack(
            [
                map_coordinates(part, np.moveaxis(held, -1, 0), order=1)
                for part in np.moveaxis(frame.velocity_m_s, -1, 0)
            ],
            axis=-1,
        )
        # the Jacobian of a point's place in the image [px], by central differences
        ahead = 1e-4 * wind
        motions.append(
            (_in_image(x + ahead, camera, frame, axes, size) - _in_image(x - ahead, camera, frame, axes, size)) / 2e-4
        )
        weights.append(weight)
    weight, motion = np.array(weights)[..., None], frame_s * np.array(motions)
    total = np.maximum(weight.sum(axis=0), 1e-30)
    mean = (weight * motion).sum(axis=0) / total
    variance = (weight * (motion - mean) ** 2).sum(axis=0) / total
    seen = weight.sum(axis=0) > 1e-4
    return np.where(seen, mean, 0.0), np.where(seen, variance, 0.0), 1.0 - remaining


def _in_image(x: np.ndarray, camera: Camera, frame: DensityFrame, axes: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Where points [m from the grid's corner] are seen, in px to the right and down from the image's centre."""
    from_camera = x + np.array(frame.grid.origin_m) - np.array(camera.position_m)
    across = from_camera @ axes.T
    if camera.kind == "perspective":
        across = across * (camera.distance_m / -(from_camera @ np.array(camera.to_viewer)))[..., None]
    return across / np.array([camera.half_width_m, camera.half_height_m]) * 0.5 * size
