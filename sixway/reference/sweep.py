"""Optical depth from everywhere to a light and to its opposite: one walk through the smoke for both.

Smoke is looked at on a grid that stands along the light, and added up from one end to the other. That takes one
look a cell, where a march from every voxel would take one for every voxel between it and the light.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from sixway.core.frames import Grid, Vector
from sixway.reference import kernels
from sixway.reference.view import aligned, point, vector

_FINER = 2
"""Rows per voxel across the light, where they do not run through the voxels' centres anyway."""


class Sweep:
    """to_light: world unit vector towards the light; the opposite one stands at minus it."""

    def __init__(self, sigma_t, box: kernels.Box, grid: Grid, to_light: Vector) -> None:
        basis = _basis(np.array(to_light))
        aligned_with = np.abs(basis).max(axis=1) > 1.0 - 1e-6
        size = grid.voxel_size_m / np.where(aligned_with, 1, (_FINER, _FINER, 1))
        extent = np.abs(basis) @ np.array(grid.extent_m)
        counts = np.maximum(np.ceil(extent / size - 1e-4).astype(int), 1)  # 1e-4: rounding adds no cell
        lowest = -0.5 * counts * size  # along the basis, from the centre of the grid
        across, up, along = (int(count) for count in counts)
        v, u = np.indices((up, across))
        first = lowest + (np.stack([u, v, np.zeros_like(u)], -1) + 0.5) * size
        world = (np.array(grid.centre_m) + first.reshape(-1, 3) @ basis).astype(np.float32)
        self._sigma_t, self._voxels = sigma_t, box
        self._step = vector(basis[2] * size[2])
        depths = kernels.swept(
            sigma_t,
            box,
            mi.Point3f(*(mi.Float(aligned(coordinate)) for coordinate in world.T)),
            self._step,
            dr.opaque(mi.UInt32, along),
        )
        self._depths = kernels.grid_texture(mi.TensorXf(depths, (along, up, across, 1)))
        self._corner = point(np.array(grid.centre_m) + lowest @ basis)
        self._axes = [vector(axis) for axis in basis / (counts * size)[:, None]]
        self._planes = dr.opaque(mi.Float, along)

    def at_voxels(self, centres) -> tuple:
        """Optical depth towards the light and towards its opposite, as linear interpolation between voxels needs it.

        Where sigma_t rises along the light, optical depth bulges, and chords lie beside a bulge: a twelfth of
        the curvature, h (sigma_t(x - h) - sigma_t(x + h)) / 2, is taken off (Condat, Blu, Unser 2005). Across the
        light it is as straight between voxels as sigma_t itself.
        """
        u, v, w = (dr.dot(centres - self._corner, axis) for axis in self._axes)
        beyond = w * self._planes - 0.5
        plane = dr.floor(beyond)
        beyond -= plane
        size = dr.norm(self._step)
        ends = self._extinction(centres) + self._extinction(centres - beyond * self._step)
        start = self._depths.eval(mi.Point3f(u, v, (plane + 0.5) / self._planes))[0]
        behind = start + 0.5 * beyond * size * ends
        whole = self._depths.eval(mi.Point3f(u, v, mi.Float(1)))[0]
        rise = self._extinction(centres + self._step) - self._extinction(centres - self._step)
        bulge = size / 24.0 * rise
        return whole - behind + bulge, behind - bulge

    def _extinction(self, points):
        return self._sigma_t.eval(self._voxels.to_texture(points))[0]


def _basis(along: np.ndarray) -> np.ndarray:
    """Rows are orthonormal, the last one `along`; voxels line up with it where that is possible."""
    nearest = np.eye(3)[np.abs(along).argmin()]
    across = np.cross(nearest, along)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(along, across), along])
