"""The bodies of a scenario as the solids that shading and tracing know."""

import numpy as np
import trimesh
from jaxtyping import Float, Int

from sixway.core.solids import Box, Cylinder, Mesh, Solid, Sphere
from sixway.sim.bodies.shapes import Body, BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody

_SEGMENTS = 32
"""Around a capsule, which has no solid of its own: its surface is at most 0.5 % of its radius too far in."""


def solid_at(body: Body, time_s: float) -> Solid:
    """The body where it is `time_s` after the inlets opened [world, m].

    Spheres, cylinders and boxes along the world's axes stay what they are; others become triangles. Raises TypeError
    for a kind of body that has no solid.
    """
    centre, rotation = body.placement(time_s)
    match body:
        case SphereBody():
            return Sphere(centre_m=_vector(centre), radius_m=body.radius_m)
        case CylinderBody():
            half = rotation[:, 2] * body.half_extent_m[2]
            return Cylinder(start_m=_vector(centre - half), end_m=_vector(centre + half), radius_m=body.radius_m)
        case BoxBody():
            edges = np.abs(rotation) @ np.array(body.size_m)
            if np.allclose(np.abs(rotation).max(axis=0), 1.0, atol=1e-9):  # a turn by quarters leaves its axes there
                return Box(centre_m=_vector(centre), size_m=_vector(edges))
            shape = trimesh.creation.box(extents=body.size_m)
            return _mesh(shape.vertices, shape.faces, centre, rotation)
        case CapsuleBody():
            shape = trimesh.creation.capsule(height=body.length_m, radius=body.radius_m, count=[_SEGMENTS, _SEGMENTS])
            vertices = shape.vertices - shape.bounds.mean(axis=0)
            return _mesh(vertices, shape.faces, centre, rotation)
        case MeshBody():
            return _mesh(body.size_m * body.surface.vertices, body.surface.faces, centre, rotation)
        case _:
            raise TypeError(f"{type(body).__name__} has no solid; give it a case here")


def _mesh(
    corners_m: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    centre_m: Float[np.ndarray, "3"],
    rotation: Float[np.ndarray, "3 3"],
) -> Mesh:
    return Mesh(corners_m=np.asarray(corners_m) @ rotation.T + centre_m, faces=np.asarray(faces))


def _vector(values: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
