"""Solids as a user writes them down on a command line.

    sphere@X:Y:Z,radius=R
    box@X:Y:Z,size=WxHxD                 edges along the world's axes
    cylinder@X:Y:Z@X:Y:Z,radius=R        the middles of its two ends
    mesh@FILE@X:Y:Z,size=S               .obj, .stl or .ply: the middle of its bounds and their longest edge
    mesh@FILE                            the same where it stands in the file, in the coordinates of the volume's file

Points and lengths are those of `sixway.shading.notation`: in radii of the volume's bounding sphere, points from its
centre, in the world (at yaw 0, x is right and z towards the viewer).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sixway.core.frames import Grid, Vector
from sixway.core.solids import Box, Cylinder, Mesh, Solid, Sphere
from sixway.sim.bodies.meshes import read_surface
from sixway.volumes.read import Up

SOLID_FORMS = (
    "sphere@X:Y:Z,radius=R, box@X:Y:Z,size=WxHxD, cylinder@X:Y:Z@X:Y:Z,radius=R, mesh@FILE or mesh@FILE@X:Y:Z,size=S"
)
"""In one line; the head of this file says what they mean."""


def parse_solid(text: str, grid: Grid, *, up: Up) -> Solid:
    """One solid around the volume in `grid`. up: which axis of a mesh that stays in its place points up.

    Raises ValueError for what is no solid and for meshes that cannot be read.
    """
    where, *rest = (part.strip() for part in text.split(","))
    kind, *places = where.split("@")
    options = dict(part.partition("=")[::2] for part in rest)
    match kind, len(places):
        case "sphere", 1:
            (radius,) = _lengths(text, options, "radius", 1, grid)
            return Sphere(centre_m=_point(text, places[0], grid), radius_m=radius)
        case "box", 1:
            x, y, z = _lengths(text, options, "size", 3, grid)
            return Box(centre_m=_point(text, places[0], grid), size_m=(x, y, z))
        case "cylinder", 2:
            (radius,) = _lengths(text, options, "radius", 1, grid)
            start, end = (_point(text, place, grid) for place in places)
            if start == end:
                raise ValueError(f"solid {text!r} has no length; give two different points")
            return Cylinder(start_m=start, end_m=end, radius_m=radius)
        case "mesh", 1 if not options:
            surface = read_surface(_file(text, places[0]))
            corners = surface.centre + surface.edge * surface.vertices
            return Mesh(corners_m=corners if up == "y" else _z_up_to_y_up(corners), faces=surface.faces)
        case "mesh", 2:
            (size,) = _lengths(text, options, "size", 1, grid)
            surface = read_surface(_file(text, places[0]))
            corners = np.array(_point(text, places[1], grid)) + size * surface.vertices
            return Mesh(corners_m=corners, faces=surface.faces)
    raise ValueError(f"solid {text!r} is none of {SOLID_FORMS}")


def mesh_file(text: str) -> Path | None:
    """The file that a solid comes from, if it is a mesh."""
    kind, *places = text.partition(",")[0].split("@")
    return Path(places[0].strip()) if kind.strip() == "mesh" and places else None


def _file(text: str, name: str) -> Path:
    path = Path(name)
    if not path.is_file():
        raise ValueError(f"solid {text!r}: {path}: there is no such mesh file")
    return path


def _lengths(text: str, options: Mapping[str, str], key: str, count: int, grid: Grid) -> list[float]:
    """``key=AxB`` in metres; the only option that there may be."""
    if options.keys() != {key}:
        raise ValueError(f"solid {text!r} needs {key}= and nothing else behind its place; it is one of {SOLID_FORMS}")
    try:
        lengths = [float(part) for part in options[key].split("x")]
    except ValueError:
        lengths = []
    if len(lengths) != count or not all(0.0 < length < float("inf") for length in lengths):
        wanted = "a length" if count == 1 else "x".join("WHD"[:count])
        raise ValueError(f"solid {text!r}: {key}={options[key]} is not {wanted}, positive and finite")
    return [length * grid.radius_m for length in lengths]


def _point(text: str, place: str, grid: Grid) -> Vector:
    try:
        x, y, z = (float(part) for part in place.split(":"))
    except ValueError as error:
        raise ValueError(f"solid {text!r}: {place!r} is not a point X:Y:Z; a solid is one of {SOLID_FORMS}") from error
    x, y, z = np.array(grid.centre_m) + grid.radius_m * np.array([x, y, z])
    return (float(x), float(y), float(z))


def _z_up_to_y_up(corners: np.ndarray) -> np.ndarray:
    """As volumes are turned: (x, y, z) becomes (x, z, -y)."""
    return corners[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])
