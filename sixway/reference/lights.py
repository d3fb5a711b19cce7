"""Lights around the smoke, for pictures under any light: records that check themselves."""

import math
from dataclasses import dataclass

import numpy as np

from sixway.core.frames import Vector

MOST_ANGLE_DEG = 60.0
_DISC_POINTS = 32

Colour = tuple[float, float, float]
"""Linear RGB, finite and >= 0."""


@dataclass(frozen=True, kw_only=True)
class DirectionalLight:
    """A sun. to_light: unit vector from the smoke towards it, CAMERA frame (z towards the viewer).

    colour: a white Lambertian facing the light shows it (irradiance pi * colour), as in `sixway.shading.light`.
    angle_deg: diameter of its disc, seen from the smoke, in [0, 60]; 0 casts hard shadows (our sun: 0.53).
    """

    to_light: Vector
    colour: Colour = (1.0, 1.0, 1.0)
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        _check_unit("to_light", self.to_light)
        if not 0.0 <= self.angle_deg <= MOST_ANGLE_DEG:
            raise ValueError(f"light of {self.angle_deg} deg must be from 0 to {MOST_ANGLE_DEG} deg wide")
        _check_colour("colour", self.colour)


@dataclass(frozen=True, kw_only=True)
class PointLight:
    """A lamp of no size. position_m: world. intensity: radiant intensity per steradian, RGB."""

    position_m: Vector
    intensity: Colour

    def __post_init__(self) -> None:
        _check_finite("position_m", self.position_m)
        _check_colour("intensity", self.intensity)


@dataclass(frozen=True, kw_only=True)
class SpotLight:
    """A lamp with a cone. towards: unit vector of its axis, world, the way the light travels.

    intensity: on the axis, per steradian, RGB. Up to `beam_deg` from the axis it is full, from there to
    `cutoff_deg` it falls linearly with the angle to zero.
    """

    position_m: Vector
    towards: Vector
    intensity: Colour
    cutoff_deg: float = 20.0
    beam_deg: float = 15.0

    def __post_init__(self) -> None:
        _check_finite("position_m", self.position_m)
        _check_unit("towards", self.towards)
        _check_colour("intensity", self.intensity)
        if not 0.0 <= self.beam_deg < self.cutoff_deg < 90.0:
            raise ValueError(
                f"spot of beam {self.beam_deg} deg and cutoff {self.cutoff_deg} deg needs 0 <= beam < cutoff < 90"
            )


@dataclass(frozen=True, kw_only=True)
class ConstantEnvironment:
    """The same radiance from everywhere, RGB. It lights the smoke and is not seen behind it."""

    radiance: Colour

    def __post_init__(self) -> None:
        _check_colour("radiance", self.radiance)


Light = DirectionalLight | PointLight | SpotLight | ConstantEnvironment


def sun_disc(to_light: Vector, angle_deg: float) -> list[Vector]:
    """Unit vectors spread evenly over a disc of that angular diameter about a unit vector; the vector alone for 0.

    Each brings the same part of the irradiance. Those of the opposite vector are opposite.
    """
    if angle_deg == 0.0:
        return [to_light]
    axis = np.array(to_light)
    main = int(np.abs(axis).argmax())
    across = np.cross(np.eye(3)[main - 1], np.abs(axis[main]) / axis[main] * axis)  # alike for both ends of the axis
    across /= np.linalg.norm(across)
    up = np.cross(axis, across) * np.sign(axis[main])
    index = np.arange(_DISC_POINTS) + 0.5
    cosine = 1.0 - index / _DISC_POINTS * (1.0 - math.cos(math.radians(0.5 * angle_deg)))
    turn = math.pi * (3.0 - math.sqrt(5.0)) * index  # Vogel's spiral
    sine = np.sqrt(1.0 - cosine**2) * np.sign(axis[main])
    points = cosine[:, None] * axis + sine[:, None] * (np.outer(np.cos(turn), across) + np.outer(np.sin(turn), up))
    return [(float(x), float(y), float(z)) for x, y, z in points]


def _check_finite(name: str, vector: Vector) -> None:
    if len(vector) != 3 or not all(map(math.isfinite, vector)):
        raise ValueError(f"{name} {vector} must be three finite numbers")


def _check_unit(name: str, vector: Vector) -> None:
    _check_finite(name, vector)
    length = float(np.linalg.norm(vector))
    if abs(length - 1.0) > 1e-4:
        raise ValueError(f"{name} {vector} has length {length:g}; it must be a unit vector")


def _check_colour(name: str, colour: Colour) -> None:
    if len(colour) != 3 or not all(math.isfinite(c) and c >= 0.0 for c in colour):
        raise ValueError(f"{name} {colour} must be three finite numbers >= 0")
