"""Lights as a user writes them down on a command line.

    right                       a sun: NAME or X:Y:Z towards it, in the camera's frame (z towards the viewer)
    point@X:Y:Z                 a lamp
    spot@X:Y:Z@X:Y:Z            a lamp and the point that its cone is aimed at
    line@X:Y:Z@X:Y:Z            a glowing wire between two points
    rectangle@X:Y:Z@X:Y:Z       the centre of a glowing panel and the point that it faces

each with ``,R,G,B`` and ``,key=value`` behind it where wanted: ``spot@2:1:0@0:0:0,3,2,1,cone=30,range=4``. Points
stand in the world, in radii of the volume's bounding sphere from its centre (at yaw 0, x is right and z towards the
viewer). Keys: angle [deg] of a sun; cone and beam [deg] of a spot, full opening; size=WxH of a panel; range.
R,G,B of a lamp is what a white surface that faces it shows one radius away, on a spot's axis; of a panel, its own.
"""

import math
from collections.abc import Mapping

import numpy as np

from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.core.frames import Grid, Vector
from sixway.shading.light import (
    Colour,
    DirectionalLight,
    Light,
    LineLight,
    PointLight,
    RectangleLight,
    SpotLight,
    unit,
)

LIGHT_FORMS = "NAME[,R,G,B], X:Y:Z[,R,G,B], or a lamp: KIND@X:Y:Z[@X:Y:Z][,R,G,B][,key=value]"
"""In one line; `parse_light` has the rest."""

_KEYS = {
    "point": {"range"},
    "spot": {"range", "cone", "beam"},
    "line": {"range"},
    "rectangle": {"range", "size"},
}
_POINTS = {"point": 1, "spot": 2, "line": 2, "rectangle": 2}
_LAMP_RADII = 0.02
"""Size of a lamp: nearer than that it grows no brighter."""


def parse_light(text: str, grid: Grid) -> Light:
    """One light around the volume in `grid`, as the head of this file says. Raises ValueError."""
    where, colour, options = _split(text)
    kind, at, places = where.partition("@")
    if not at:
        return parse_sun(text)
    if kind not in _KEYS:
        raise ValueError(f"light {text!r}: no kind of light is called {kind!r}; known: {', '.join(_KEYS)}")
    unknown = sorted(options.keys() - _KEYS[kind])
    if unknown:
        known = ", ".join(sorted(_KEYS[kind]))
        raise ValueError(f"light {text!r}: a {kind} has no {', '.join(unknown)}; it has {known}")
    points = [_point(text, place, grid) for place in places.split("@")]
    if len(points) != _POINTS[kind]:
        raise ValueError(f"light {text!r}: a {kind} takes {_POINTS[kind]} point(s) @X:Y:Z, got {len(points)}")
    numbers = {key: _number(text, key, value) for key, value in options.items() if key != "size"}
    radius = grid.radius_m
    range_m = numbers.get("range", math.inf) * radius
    red, green, blue = (part * math.pi * radius**2 for part in colour)  # intensity, from what a white surface shows
    lamp = _LAMP_RADII * radius
    match kind:
        case "point":
            return PointLight(position_m=points[0], intensity=(red, green, blue), range_m=range_m, radius_m=lamp)
        case "spot":
            cone = numbers.get("cone", 40.0)
            return SpotLight(
                position_m=points[0],
                towards=_towards(text, *points),
                intensity=(red, green, blue),
                cutoff_deg=0.5 * cone,
                beam_deg=0.5 * numbers.get("beam", 0.75 * cone),
                range_m=range_m,
                radius_m=lamp,
            )
        case "line":
            return LineLight(
                start_m=points[0], end_m=points[1], intensity=(red, green, blue), range_m=range_m, radius_m=lamp
            )
        case _:
            return _panel(text, points, options.get("size", "1x1"), grid, colour, range_m)


def parse_sun(text: str) -> DirectionalLight:
    """``NAME`` or ``X:Y:Z``, then optionally ``,R,G,B``: ``right,1,0.9,0.8`` or ``1:1:0.5,2,2,2,angle=3``.

    X:Y:Z points towards the light in the camera frame and is normalised. Raises ValueError.
    """
    where, colour, options = _split(text)
    try:
        x, y, z = TO_LIGHT[where] if where in TO_LIGHT else (float(v) for v in where.split(":"))
    except ValueError as error:
        raise ValueError(_rule(text)) from error
    if options.keys() - {"angle"}:
        raise ValueError(f"light {text!r}: a sun has no {', '.join(sorted(options))}; it has angle")
    length = math.hypot(x, y, z)
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"light {text!r} points nowhere; give a vector that is not zero")
    angle = _number(text, "angle", options["angle"]) if "angle" in options else 0.0
    return DirectionalLight(to_light=unit((x, y, z)), colour=colour, angle_deg=angle)


def parse_rgb(text: str, *, name: str) -> Colour:
    """``R,G,B``, finite and not negative. name: what to call it in the ValueError."""
    try:
        red, green, blue = (float(value) for value in text.split(","))
    except ValueError as error:
        raise ValueError(f"{name} {text!r} is not R,G,B") from error
    if not all(0.0 <= value < math.inf for value in (red, green, blue)):
        raise ValueError(f"{name} {text!r} must be finite and not negative")
    return (red, green, blue)


def _rule(text: str) -> str:
    return (
        f"light {text!r} is not NAME[,R,G,B], X:Y:Z[,R,G,B] or KIND@X:Y:Z[@X:Y:Z][,R,G,B][,key=value]; "
        f"names: {', '.join(DIRECTIONS)}; kinds: {', '.join(_KEYS)}"
    )


def _split(text: str) -> tuple[str, Colour, Mapping[str, str]]:
    where, *rest = (part.strip() for part in text.split(","))
    options = dict(part.split("=", 1) for part in rest if "=" in part)
    plain = [part for part in rest if "=" not in part]
    try:
        red, green, blue = (float(part) for part in plain) if plain else (1.0, 1.0, 1.0)
    except ValueError as error:
        raise ValueError(_rule(text)) from error
    return where, (red, green, blue), options


def _number(text: str, key: str, value: str) -> float:
    try:
        return float(value)
    except ValueError as error:
        raise ValueError(f"light {text!r}: {key}={value} is no number") from error


def _point(text: str, place: str, grid: Grid) -> Vector:
    try:
        x, y, z = (float(part) * grid.radius_m for part in place.split(":"))
    except ValueError as error:
        raise ValueError(_rule(text)) from error
    return (grid.centre_m[0] + x, grid.centre_m[1] + y, grid.centre_m[2] + z)


def _towards(text: str, start: Vector, end: Vector) -> Vector:
    x, y, z = np.array(end) - start
    if not math.hypot(x, y, z) > 0.0:
        raise ValueError(f"light {text!r} is aimed at itself; give two different points")
    return unit((float(x), float(y), float(z)))


def _panel(text: str, points: list[Vector], size: str, grid: Grid, colour: Colour, range_m: float) -> RectangleLight:
    """Its upper edge is level; one that faces straight up or down has its right to the world's right."""
    try:
        width, height = (0.5 * float(part) * grid.radius_m for part in size.split("x"))
    except ValueError as error:
        raise ValueError(f"light {text!r}: size={size} is not WxH") from error
    facing = np.array(_towards(text, *points))
    right = np.cross((0.0, 1.0, 0.0), facing)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array([1.0, 0.0, 0.0])
    up = np.cross(facing, right)
    half_right, half_up = ((float(x), float(y), float(z)) for x, y, z in (right * width, up * height))
    return RectangleLight(
        centre_m=points[0], half_right_m=half_right, half_up_m=half_up, radiance=colour, range_m=range_m
    )
