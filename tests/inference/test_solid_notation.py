"""Solids written on a command line: where they stand, how large they are, and what is no solid."""

from pathlib import Path

import numpy as np
import pytest

from sixway.core.frames import Grid
from sixway.core.solids import Box, Cylinder, Mesh, Sphere
from sixway.inference.solid_notation import mesh_file, parse_solid

GRID = Grid(shape_zyx=(4, 4, 2), voxel_size_m=1.0, origin_m=(9.0, 18.0, 28.0))
"""Centred on (10, 20, 30), bounding radius 3 m."""
TETRAHEDRON = "v 1 2 3\nv 5 2 3\nv 1 4 3\nv 1 2 6\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def tetrahedron(tmp_path: Path) -> Path:
    """From (1, 2, 3) to (5, 4, 6): its longest edge has 4 m."""
    path = tmp_path / "tetrahedron.obj"
    path.write_text(TETRAHEDRON)
    return path


def bounds(mesh: object) -> tuple[np.ndarray, np.ndarray]:
    assert isinstance(mesh, Mesh)
    return mesh.corners_m.min(axis=0), mesh.corners_m.max(axis=0)


def test_primitives_stand_in_radii_of_the_volume() -> None:
    assert parse_solid("sphere@1:0:-1,radius=0.5", GRID, up="y") == Sphere(centre_m=(13.0, 20.0, 27.0), radius_m=1.5)
    box = Box(centre_m=(10.0, 23.0, 30.0), size_m=(3.0, 6.0, 1.5))
    assert parse_solid("box@0:1:0, size=1x2x0.5", GRID, up="z") == box  # what is told here has y up whatever the file
    pole = Cylinder(start_m=(10.0, 17.0, 30.0), end_m=(10.0, 23.0, 30.0), radius_m=0.375)
    assert parse_solid("cylinder@0:-1:0@0:1:0,radius=0.125", GRID, up="y") == pole


def test_a_mesh_stands_where_its_file_says_or_where_it_is_put(tetrahedron: Path) -> None:
    low, high = bounds(parse_solid(f"mesh@{tetrahedron}", GRID, up="y"))
    np.testing.assert_allclose([low, high], [(1, 2, 3), (5, 4, 6)])
    low, high = bounds(parse_solid(f"mesh@{tetrahedron}", GRID, up="z"))  # (x, y, z) becomes (x, z, -y)
    np.testing.assert_allclose([low, high], [(1, 3, -4), (5, 6, -2)])
    low, high = bounds(parse_solid(f"mesh@{tetrahedron}@1:0:0,size=2", GRID, up="y"))
    np.testing.assert_allclose(0.5 * (low + high), (13, 20, 30))
    np.testing.assert_allclose(high - low, (6.0, 3.0, 4.5))


def test_what_a_solid_is_read_from() -> None:
    assert mesh_file("mesh@a/b.ply") == mesh_file("mesh@a/b.ply@0:0:0,size=1") == Path("a/b.ply")
    assert mesh_file("sphere@0:0:0,radius=1") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is none of sphere@X:Y:Z,radius=R, box"),
        ("cone@0:0:0,radius=1", "is none of sphere"),
        ("sphere@0:0:0@1:1:1,radius=1", "is none of sphere"),
        ("mesh@a.ply,size=1", "is none of sphere"),
        ("sphere@0:0:0", "needs radius= and nothing else"),
        ("sphere@0:0:0,size=1", "needs radius= and nothing else"),
        ("box@0:0:0,size=1x2x3,radius=1", "needs size= and nothing else"),
        ("box@0:0:0,size=1x2", "size=1x2 is not WxHxD, positive and finite"),
        ("sphere@0:0:0,radius=-1", "radius=-1 is not a length, positive and finite"),
        ("sphere@0:0:0,radius=wide", "radius=wide is not a length"),
        ("sphere@0:0:0,radius=nan", "radius=nan is not a length"),
        ("sphere@0:0,radius=1", "'0:0' is not a point X:Y:Z"),
        ("sphere@a:0:0,radius=1", "'a:0:0' is not a point X:Y:Z"),
        ("sphere@inf:0:0,radius=1", "must be three finite numbers"),
        ("cylinder@0:0:0@0:0:0,radius=1", "has no length; give two different points"),
        ("mesh@none.ply", r"none\.ply: there is no such mesh file"),
        ("mesh@none.ply@0:0:0", "needs size= and nothing else"),
    ],
)
def test_what_is_no_solid_is_told(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_solid(text, GRID, up="y")
