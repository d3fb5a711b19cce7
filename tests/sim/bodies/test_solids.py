"""A body's solid stands where the body is: its surface is where the body's own distance is zero."""

from pathlib import Path

import numpy as np
import pytest

from sixway.core.solids import Box, Cylinder, Mesh, Sphere
from sixway.sim.bodies.motion import RigidMotion
from sixway.sim.bodies.shapes import BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody
from sixway.sim.bodies.solids import solid_at

BUNNY = Path(__file__).parents[3] / "configs" / "sim" / "meshes" / "bunny.ply"
MOVING = {
    "centre_m": (0.1, -0.2, 0.05),
    "motion": RigidMotion(kind="rigid", velocity_m_s=(0.1, 0.2, 0.0), spin_deg_s=(0.0, 70.0, 20.0)),
}
BODIES = {
    "sphere": SphereBody(kind="sphere", radius_m=0.2, **MOVING),
    "cylinder": CylinderBody(kind="cylinder", radius_m=0.1, length_m=0.5, axis=(1.0, 1.0, 0.0), **MOVING),
    "box": BoxBody(kind="box", size_m=(0.3, 0.2, 0.4), rotation_deg=(10.0, 20.0, 30.0), **MOVING),
    "capsule": CapsuleBody(kind="capsule", radius_m=0.1, length_m=0.3, axis="y", **MOVING),
}


def surface(solid: Sphere | Cylinder | Box | Mesh) -> np.ndarray:
    """Points on the solid [n, 3]."""
    match solid:
        case Sphere():
            return np.array(solid.centre_m) + solid.radius_m * np.eye(3)
        case Cylinder():
            start, end = np.array(solid.start_m), np.array(solid.end_m)
            across = np.cross(end - start, (0.0, 0.0, 1.0))
            return np.array([start, end, 0.5 * (start + end) + solid.radius_m * across / np.linalg.norm(across)])
        case Box():
            return np.array(solid.centre_m) + 0.5 * np.array(solid.size_m) * np.array([(1, 1, 1), (-1, 1, -1)])
        case _:
            return solid.corners_m


@pytest.mark.parametrize("time_s", [0.0, 0.7])
@pytest.mark.parametrize("name", BODIES)
def test_the_solid_is_where_the_body_is(name: str, time_s: float) -> None:
    body = BODIES[name]
    points = surface(solid_at(body, time_s))
    np.testing.assert_allclose(body.signed_distance(points, time_s), 0.0, atol=1e-6)
    assert np.abs(points - surface(solid_at(body, 1.3))).max() > 0.05  # it moves


def test_a_box_along_the_axes_stays_a_box() -> None:
    turned_by_quarters = BoxBody(kind="box", centre_m=(0.0, 0.1, 0.0), size_m=(0.3, 0.2, 0.4), rotation_deg=(0, 90, 0))
    solid = solid_at(turned_by_quarters, 0.0)
    assert isinstance(solid, Box)
    np.testing.assert_allclose(solid.size_m, (0.4, 0.2, 0.3))


def test_a_mesh_keeps_its_triangles() -> None:
    body = MeshBody(kind="mesh", path=str(BUNNY), centre_m=(0.2, 0.1, 0.0), size_m=0.5, rotation_deg=(0.0, 180.0, 0.0))
    solid = solid_at(body, 0.0)
    assert isinstance(solid, Mesh) and solid.faces.shape == body.surface.faces.shape
    low, high = body.bounds_m(0.0)
    np.testing.assert_allclose((solid.corners_m.min(axis=0), solid.corners_m.max(axis=0)), (low, high), atol=1e-9)
