"""What needs no light, by a march in plain NumPy: alpha and fire, for renderers whose film keeps neither."""

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera
from sixway.reference.media import Extinction

_STEP_VOXELS = 0.5
_SUBPIXELS = 2


def march_unlit(extinction: Extinction, camera: Camera) -> Float[np.ndarray, "h w 2"]:
    """Alpha, 1 - exp(-optical depth), and emissive along the camera's rays, the mean of 2 x 2 points of every pixel.

    emissive = sum over the steps of T eps (1 - exp(-sigma_t h)) / sigma_t; float32.
    """
    fine = camera.resized(camera.width_px * _SUBPIXELS, camera.height_px * _SUBPIXELS)
    origins, rays = (vectors.reshape(-1, 3) for vectors in fine.rays())
    grid = extinction.grid
    lower = np.array(grid.origin_m)
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray may run along a face
        near, far = (lower - origins) / rays, (lower + grid.extent_m - origins) / rays
    enter = np.maximum(np.nanmax(np.minimum(near, far), axis=1), 0.0)
    leave = np.nanmin(np.maximum(near, far), axis=1)
    step = _STEP_VOXELS * grid.voxel_size_m
    depth, emissive = np.zeros(len(rays)), np.zeros(len(rays))
    burns = extinction.emission.any()
    hit = np.flatnonzero(leave > enter)
    distance = enter[hit] + 0.5 * step
    while hit.size:
        points = (origins[hit] + distance[:, None] * rays[hit] - lower) / grid.voxel_size_m - 0.5
        thickness = step * _interpolate(extinction.sigma_t, points)
        if burns:
            slab = np.where(thickness > 1e-8, -np.expm1(-thickness) / np.maximum(thickness, 1e-8), 1.0)
            emissive[hit] += np.exp(-depth[hit]) * step * slab * _interpolate(extinction.emission, points)
        depth[hit] += thickness
        distance = distance + step
        inside = distance < leave[hit]
        hit, distance = hit[inside], distance[inside]
    both = np.stack([1.0 - np.exp(-depth), emissive], axis=-1)
    blocks = both.reshape(camera.height_px, _SUBPIXELS, camera.width_px, _SUBPIXELS, 2)
    return blocks.mean(axis=(1, 3)).astype(np.float32)


def _interpolate(values: Float[np.ndarray, "z y x"], ijk: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Trilinear values at (x, y, z) voxel coordinates, whole numbers at voxel centres; clamped."""
    limit = np.array(values.shape[::-1]) - 1
    clamped = np.clip(ijk, 0, limit)
    base = np.minimum(clamped.astype(np.int64), np.maximum(limit - 1, 0))
    x, y, z = (clamped - base).T
    i, j, k = base.T
    result = np.zeros(len(ijk))
    for dz, wz in ((0, 1 - z), (1, z)):
        for dy, wy in ((0, 1 - y), (1, y)):
            result += wz * wy * ((1 - x) * values[k + dz, j + dy, i] + x * values[k + dz, j + dy, i + 1])
    return result
