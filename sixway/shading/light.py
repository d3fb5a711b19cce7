"""Directional lights in the camera frame, and how a user writes one down."""

import math
from dataclasses import dataclass

import numpy as np

from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.core.frames import Vector


@dataclass(frozen=True, kw_only=True)
class DirectionalLight:
    """A sun. to_light: unit vector from the smoke towards it, camera frame (z towards the viewer).

    colour: linear RGB >= 0, in units where a white Lambertian facing the light shows `colour`
    (irradiance pi * colour). Raises ValueError for a zero vector or a negative or infinite colour.
    """

    to_light: Vector
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        length = math.hypot(*self.to_light)
        if not (math.isfinite(length) and abs(length - 1.0) < 1e-4):
            raise ValueError(f"to_light {self.to_light} has length {length:g}; it must be a unit vector")
        if not all(math.isfinite(c) and c >= 0.0 for c in self.colour):
            raise ValueError(f"light colour {self.colour} must be finite and not negative")

    @classmethod
    def parse(cls, text: str) -> "DirectionalLight":
        """``NAME`` or ``X:Y:Z``, then optionally ``,R,G,B``: ``right,1,0.9,0.8`` or ``1:1:0.5,2,2,2``.

        X:Y:Z points towards the light in the camera frame and is normalised. Raises ValueError.
        """
        where, *colour = (part.strip() for part in text.split(","))
        rule = f"light {text!r} is not NAME[,R,G,B] or X:Y:Z[,R,G,B]; names: {', '.join(DIRECTIONS)}"
        try:
            x, y, z = TO_LIGHT[where] if where in TO_LIGHT else (float(v) for v in where.split(":"))
            red, green, blue = (float(c) for c in colour) if colour else (1.0, 1.0, 1.0)
        except ValueError as error:
            raise ValueError(rule) from error
        length = math.hypot(x, y, z)
        if not (math.isfinite(length) and length > 0.0):
            raise ValueError(f"light {text!r} points nowhere; give a vector that is not zero")
        return cls(to_light=(x / length, y / length, z / length), colour=(red, green, blue))

    def turned(self, degrees: float) -> "DirectionalLight":
        """The light carried around the camera's up axis: from the front towards the right."""
        angle = math.radians(degrees)
        x, y, z = self.to_light
        turned = (x * math.cos(angle) + z * math.sin(angle), y, z * math.cos(angle) - x * math.sin(angle))
        length = float(np.hypot(np.hypot(*turned[:2]), turned[2]))
        return type(self)(to_light=(turned[0] / length, turned[1] / length, turned[2] / length), colour=self.colour)
