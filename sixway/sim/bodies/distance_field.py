"""The signed distance to a mesh on a grid of its own, made once and then read wherever the mesh moves to."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import warp as wp
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt

from sixway.sim.bodies.meshes import Surface
from sixway.sim.bodies.voxelise_kernels import mesh_distance

_MARGIN = 2
"""Samples around the bounds, so that the rim of the grid is always outside."""

_MOST_MISSING = 0.05
"""Share of the outline that may lack triangles before a mesh counts as too open."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DistanceField:
    """Signed distance of a `Surface`, whose longest edge is 1, negative inside.

    values: [z, y, x] float32 at samples `spacing` apart; the grid is centred on 0.
    missing: share of the outline that no triangle covers, 0 for a watertight mesh.
    """

    values: Float[np.ndarray, "z y x"]
    spacing: float
    missing: float

    @property
    def half_extent(self) -> Float[np.ndarray, "3"]:
        """Half the edges of the grid along x, y, z."""
        return 0.5 * self.spacing * (np.array(self.values.shape[::-1]) - 1)

    def sample(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Trilinear, float64; beyond the grid the distance to it is added. Twin of the kernels."""
        within = np.clip(points, -self.half_extent, self.half_extent)
        at = (within + self.half_extent) / self.spacing
        low = np.minimum(at.astype(int), np.array(self.values.shape[::-1]) - 2)
        part = at - low
        value = np.zeros(len(points))
        for corner in np.ndindex(2, 2, 2):
            x, y, z = (low + corner).T
            value += np.prod(np.where(corner, part, 1.0 - part), axis=1) * self.values[z, y, x]
        return value + np.linalg.norm(points - within, axis=1)


@lru_cache(maxsize=8)
def distance_field(surface: Surface, resolution: int) -> DistanceField:
    """Sample the distance on the CPU with `resolution` samples along the longest edge.

    Where the mesh has a hole, its winding number closes it (Jacobson et al. 2013): the surface across the hole is
    where that number is 1/2. Raises ValueError, naming the file, for a mesh that encloses nothing, or of whose
    outline more than a twentieth is such a guess.
    """
    spacing = 1.0 / resolution
    shape_zyx = [int(np.ceil(2.0 * half / spacing)) + 1 + 2 * _MARGIN for half in surface.half_extent[::-1]]
    origin = -0.5 * spacing * (np.array(shape_zyx[::-1]) - 1)
    mesh = wp.Mesh(
        points=wp.array(surface.vertices, dtype=wp.vec3, device="cpu"),
        indices=wp.array(surface.faces.ravel(), dtype=wp.int32, device="cpu"),
        support_winding_number=True,
    )
    distances = wp.empty(tuple(shape_zyx), dtype=wp.float32, device="cpu")
    inputs = [0, mesh.id, wp.vec3(*origin), spacing, 4.0]
    wp.launch(mesh_distance, dim=distances.shape, inputs=inputs, outputs=[distances], device="cpu")
    values = distances.numpy().copy()
    missing = _close(values, spacing)
    if not np.any(values < -0.5 * spacing):
        raise ValueError(
            f"{surface.path}: encloses nothing at {resolution} samples along its longest edge; it has "
            f"{surface.open_edges} open edges: close the mesh, or raise `resolution` if it is thin"
        )
    if missing > _MOST_MISSING:
        raise ValueError(
            f"{surface.path}: is not watertight, and {missing:.0%} of its outline is missing, more than "
            f"{_MOST_MISSING:.0%}; it has {surface.open_edges} open edges and {surface.flipped_edges} between "
            "triangles that face opposite ways: close its holes and recalculate its normals in a mesh editor"
        )
    return DistanceField(values=values, spacing=spacing, missing=missing)


def _close(values: Float[np.ndarray, "z y x"], spacing: float) -> float:
    """Give the surface across holes its distance, in place; returns the share of it in the whole surface.

    A distance changes by no more than the way gone. So where the sign changes between two samples whose distances
    add up to more than the way between them, no triangle lies between: the sign changed in mid-air.
    """
    inside, distance = values < 0.0, np.abs(values)
    crossings = airy = 0
    for axis in range(3):
        a, b = (slice(None),) * axis + (slice(1, None),), (slice(None),) * axis + (slice(-1),)
        crosses = inside[a] != inside[b]
        crossings += int(crosses.sum())
        airy += int((crosses & (distance[a] + distance[b] > 1.01 * spacing)).sum())
    if airy:
        to_other = np.where(inside, distance_transform_edt(inside), distance_transform_edt(~inside)) * spacing
        beyond = distance > 1.01 * to_other
        values[beyond] = np.where(inside, -1.0, 1.0)[beyond] * (to_other[beyond] - 0.5 * spacing)
    return airy / max(crossings, 1)
