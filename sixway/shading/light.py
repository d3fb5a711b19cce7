"""The lights that shading knows: a sun in the camera frame, and lamps that stand in the world.

Strengths are those of `sixway.reference.lights`, so that a picture of the truth and a shaded one are alike bright.
"""

import math
from dataclasses import dataclass

import numpy as np

from sixway.core.frames import Vector

Colour = tuple[float, float, float]
"""Linear RGB, finite and >= 0."""

_LEAST_DISTANCE_M = 0.01


@dataclass(frozen=True, kw_only=True)
class DirectionalLight:
    """A sun. to_light: unit vector from the smoke towards it, CAMERA frame (z towards the viewer).

    colour: what a white Lambertian facing the light shows (irradiance pi * colour). angle_deg: diameter of its
    disc, seen from the smoke, in [0, 60]; it softens shadows and nothing else.
    """

    to_light: Vector
    colour: Colour = (1.0, 1.0, 1.0)
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        _check_unit("to_light", self.to_light)
        _check_colour("light colour", self.colour)
        if not 0.0 <= self.angle_deg <= 60.0:
            raise ValueError(f"light of {self.angle_deg} deg must be from 0 to 60 deg wide")

    @classmethod
    def parse(cls, text: str) -> "DirectionalLight":
        """A sun as `sixway.shading.notation.parse_sun` reads it."""
        from sixway.shading.notation import parse_sun

        return parse_sun(text)

    def turned(self, degrees: float) -> "DirectionalLight":
        """The light carried around the camera's up axis: from the front towards the right."""
        angle = math.radians(degrees)
        x, y, z = self.to_light
        turned = (x * math.cos(angle) + z * math.sin(angle), y, z * math.cos(angle) - x * math.sin(angle))
        return DirectionalLight(to_light=unit(turned), colour=self.colour, angle_deg=self.angle_deg)


@dataclass(frozen=True, kw_only=True)
class PointLight:
    """A lamp that shines alike everywhere. position_m: world. intensity: RGB radiant intensity per steradian.

    range_m: from there on it does not shine. radius_m: size of the lamp; nearer than that it grows no brighter.
    """

    position_m: Vector
    intensity: Colour
    range_m: float = math.inf
    radius_m: float = _LEAST_DISTANCE_M

    def __post_init__(self) -> None:
        _check_finite("position_m", self.position_m)
        _check_colour("intensity", self.intensity)
        _check_range(self.range_m)
        _check_length("radius_m", self.radius_m)


@dataclass(frozen=True, kw_only=True)
class SpotLight:
    """A lamp with a cone; the rest as `PointLight`. towards: unit vector of its axis, world, as the light travels.

    intensity: on the axis. Up to `beam_deg` from the axis it is full, from there to `cutoff_deg` it falls
    linearly with the angle to zero.
    """

    position_m: Vector
    towards: Vector
    intensity: Colour
    cutoff_deg: float = 20.0
    beam_deg: float = 15.0
    range_m: float = math.inf
    radius_m: float = _LEAST_DISTANCE_M

    def __post_init__(self) -> None:
        _check_finite("position_m", self.position_m)
        _check_unit("towards", self.towards)
        _check_colour("intensity", self.intensity)
        _check_range(self.range_m)
        _check_length("radius_m", self.radius_m)
        if not 0.0 <= self.beam_deg < self.cutoff_deg < 90.0:
            raise ValueError(
                f"spot of beam {self.beam_deg} deg and cutoff {self.cutoff_deg} deg needs 0 <= beam < cutoff < 90"
            )


@dataclass(frozen=True, kw_only=True)
class LineLight:
    """A glowing wire between two world points. intensity: of the whole wire per steradian, RGB, alike everywhere."""

    start_m: Vector
    end_m: Vector
    intensity: Colour
    range_m: float = math.inf
    radius_m: float = _LEAST_DISTANCE_M

    def __post_init__(self) -> None:
        _check_finite("start_m", self.start_m)
        _check_finite("end_m", self.end_m)
        _check_length("length_m", math.dist(self.start_m, self.end_m))
        _check_colour("intensity", self.intensity)
        _check_range(self.range_m)
        _check_length("radius_m", self.radius_m)


@dataclass(frozen=True, kw_only=True)
class RectangleLight:
    """A panel that glows on one side. half_right_m, half_up_m: from its centre to the middles of two edges, world,
    at right angles; right x up points to where it shines. radiance: RGB, alike in all directions."""

    centre_m: Vector
    half_right_m: Vector
    half_up_m: Vector
    radiance: Colour
    range_m: float = math.inf

    def __post_init__(self) -> None:
        for name in ("centre_m", "half_right_m", "half_up_m"):
            _check_finite(name, getattr(self, name))
        right, up = np.array(self.half_right_m), np.array(self.half_up_m)
        _check_length("half_right_m", float(np.linalg.norm(right)))
        _check_length("half_up_m", float(np.linalg.norm(up)))
        if abs(right @ up) > 1e-4 * np.linalg.norm(right) * np.linalg.norm(up):
            raise ValueError(f"half_right_m {self.half_right_m} and half_up_m {self.half_up_m} must be at right angles")
        _check_colour("radiance", self.radiance)
        _check_range(self.range_m)


NearLight = PointLight | SpotLight | LineLight | RectangleLight
Light = DirectionalLight | NearLight


def unit(vector: Vector) -> Vector:
    """The vector at length 1; it must not be zero."""
    length = math.hypot(*vector)
    return (vector[0] / length, vector[1] / length, vector[2] / length)


def _check_finite(name: str, vector: Vector) -> None:
    if len(vector) != 3 or not all(map(math.isfinite, vector)):
        raise ValueError(f"{name} {vector} must be three finite numbers")


def _check_unit(name: str, vector: Vector) -> None:
    length = math.hypot(*vector)
    if not (math.isfinite(length) and abs(length - 1.0) < 1e-4):
        raise ValueError(f"{name} {vector} has length {length:g}; it must be a unit vector")


def _check_colour(name: str, colour: Colour) -> None:
    if not all(math.isfinite(c) and c >= 0.0 for c in colour):
        raise ValueError(f"{name} {colour} must be finite and not negative")


def _check_length(name: str, length_m: float) -> None:
    if not (math.isfinite(length_m) and length_m > 0.0):
        raise ValueError(f"{name} {length_m} m must be positive and finite")


def _check_range(range_m: float) -> None:
    if not range_m > 0.0:
        raise ValueError(f"range_m {range_m} must be positive; infinity for a light without end")
