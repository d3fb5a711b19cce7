"""What arrives at a point from a lamp: from which direction, and how much.

Wires and panels are seen as the one direction that is the mean of all their light (the most representative
point), with the strength of the whole.
"""

import math

import numpy as np
from jaxtyping import Float

from sixway.shading.light import Colour, LineLight, NearLight, PointLight, RectangleLight, SpotLight

Points = Float[np.ndarray, "*n 3"]
Values = Float[np.ndarray, "*n"]
Arrival = tuple[Points, Values, Values]
"""Unit vectors towards a light, strength of its light, distance that its range counts."""


def arriving(light: NearLight, points_m: Points) -> tuple[Points, Points]:
    """Unit vectors towards the light and the RGB irradiance of a plane that faces it, world, float64."""
    to_light, strength = strength_at(light, points_m)
    return to_light, strength[..., None] * np.array(colour_of(light))


def strength_at(light: NearLight, points_m: Points) -> tuple[Points, Values]:
    """Unit vectors towards the light and what its colour is multiplied by: `arriving` of a light of colour 1."""
    points = np.asarray(points_m, np.float64)
    match light:
        case PointLight():
            to_light, strength, distance = _from_point(light.position_m, light.radius_m, points)
        case SpotLight():
            to_light, strength, distance = _from_point(light.position_m, light.radius_m, points)
            strength = strength * _cone(light, to_light)
        case LineLight():
            to_light, strength, distance = _from_line(light, points)
        case RectangleLight():
            to_light, strength, distance = _from_rectangle(light, points)
    return to_light, strength * window(distance, light.range_m)


def colour_of(light: NearLight) -> Colour:
    """Intensity of lamps, radiance of panels."""
    return light.radiance if isinstance(light, RectangleLight) else light.intensity


def nearest_point(light: NearLight, points_m: Points) -> Points:
    """The part of the light that is nearest to each point, world, float64."""
    points = np.asarray(points_m, np.float64)
    match light:
        case PointLight() | SpotLight():
            return np.broadcast_to(np.array(light.position_m), points.shape)
        case LineLight():
            half = 0.5 * (np.array(light.end_m) - light.start_m)
            middle = np.array(light.start_m) + half
            return middle + _clamped(points - middle, half)
        case RectangleLight():
            offset = points - np.array(light.centre_m)
            right, up = np.array(light.half_right_m), np.array(light.half_up_m)
            return np.array(light.centre_m) + _clamped(offset, right) + _clamped(offset, up)


def middle_of(light: NearLight) -> Float[np.ndarray, "3"]:
    """The middle of the light, world."""
    match light:
        case PointLight() | SpotLight():
            return np.array(light.position_m)
        case LineLight():
            return 0.5 * (np.array(light.start_m) + light.end_m)
        case RectangleLight():
            return np.array(light.centre_m)


def window(distance_m: Values, range_m: float) -> Values:
    """Fades the inverse square to 0 at `range_m`: (1 - (d / r)^4)^2 (Karis 2013, Real Shading in Unreal Engine 4)."""
    if math.isinf(range_m):
        return np.ones_like(distance_m)
    return np.maximum(1.0 - (distance_m / range_m) ** 4, 0.0) ** 2


def _from_point(position_m: tuple[float, float, float], radius_m: float, points: Points) -> Arrival:
    offset = np.array(position_m) - points
    distance = np.linalg.norm(offset, axis=-1)
    return _normalised(offset), 1.0 / np.maximum(distance, radius_m) ** 2, distance


def _cone(light: SpotLight, to_light: Points) -> Values:
    angle = np.degrees(np.arccos(np.clip(-to_light @ np.array(light.towards), -1.0, 1.0)))
    return np.clip((light.cutoff_deg - angle) / (light.cutoff_deg - light.beam_deg), 0.0, 1.0)


def _from_line(light: LineLight, points: Points) -> Arrival:
    """int ds / r^2 over the wire = angle / height: light falls evenly on the angle that the wire is seen under.

    So its mean direction halves that angle, and the strength is closed-form (angle = atan2(|a x b|, a . b) between
    the two ends, height = |a x b| / length).
    """
    a, b = np.array(light.start_m) - points, np.array(light.end_m) - points
    length_a = np.maximum(np.linalg.norm(a, axis=-1), light.radius_m)
    length_b = np.maximum(np.linalg.norm(b, axis=-1), light.radius_m)
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    across = np.maximum(across, light.radius_m * math.dist(light.start_m, light.end_m))
    along = (a * b).sum(axis=-1)
    strength = np.arctan2(across, along) / across
    middle = a / length_a[..., None] + b / length_b[..., None]
    return _normalised(middle), strength, np.minimum(length_a, length_b)


def _from_rectangle(light: RectangleLight, points: Points) -> Arrival:
    """Irradiance radiance x solid angle (Van Oosterom, Strackee 1983, Eq. 8), from Lambert's vector irradiance.

    The vector is half the sum over the edges of angle x unit normal of the edge's plane: its direction is the mean
    direction of the panel's light.
    """
    right, up = np.array(light.half_right_m), np.array(light.half_up_m)
    centre = np.array(light.centre_m) - points
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = [centre + i * right + j * up for i, j in signs]
    rays = [_normalised(corner) for corner in corners]
    solid_angle = np.abs(_triangle(rays[0], rays[1], rays[2])) + np.abs(_triangle(rays[0], rays[2], rays[3]))
    vector = np.zeros_like(points)
    for first, second in zip(rays, rays[1:] + rays[:1], strict=True):
        normal = np.cross(second, first)  # the corners go round counter-clockwise as the lit side sees them
        sine = np.linalg.norm(normal, axis=-1)
        angle = np.arctan2(sine, (first * second).sum(axis=-1))
        vector += (angle / np.maximum(sine, 1e-12))[..., None] * normal
    lit = centre @ np.cross(right, up) < 0.0
    nearest = centre - _clamped(centre, right) - _clamped(centre, up)
    return _normalised(vector), np.where(lit, solid_angle, 0.0), np.linalg.norm(nearest, axis=-1)


def _triangle(a: Points, b: Points, c: Points) -> Values:
    """Solid angle of the triangle of three unit vectors, signed."""
    volume = (a * np.cross(b, c)).sum(axis=-1)
    below = 1.0 + (a * b).sum(axis=-1) + (b * c).sum(axis=-1) + (c * a).sum(axis=-1)
    return 2.0 * np.arctan2(volume, below)


def _normalised(vectors: Points) -> Points:
    """At length 1; where light comes from all around, or from the very point, any direction will do."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), (0.0, 0.0, 1.0))


def _clamped(centre: Points, half_edge: np.ndarray) -> Points:
    """The part of `centre` along an edge of the panel, no longer than half that edge."""
    share = np.clip(centre @ half_edge / (half_edge @ half_edge), -1.0, 1.0)
    return share[..., None] * half_edge
