"""Black solids around the smoke: records that check themselves. Lengths in metres, places in the world."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sixway.core.frames import Vector


@dataclass(frozen=True, kw_only=True)
class Sphere:
    """A black ball in the world."""

    centre_m: Vector
    radius_m: float

    def __post_init__(self) -> None:
        _check_finite("centre_m", self.centre_m)
        _check_size("radius_m", self.radius_m)


@dataclass(frozen=True, kw_only=True)
class Cylinder:
    """A black cylinder with closed ends between two world points on its axis."""

    start_m: Vector
    end_m: Vector
    radius_m: float

    def __post_init__(self) -> None:
        _check_finite("start_m", self.start_m)
        _check_finite("end_m", self.end_m)
        _check_size("length_m", math.dist(self.start_m, self.end_m))
        _check_size("radius_m", self.radius_m)


@dataclass(frozen=True, kw_only=True)
class Box:
    """A black box, its edges along the world's axes. size_m: edges along x, y, z."""

    centre_m: Vector
    size_m: Vector

    def __post_init__(self) -> None:
        _check_finite("centre_m", self.centre_m)
        for edge in self.size_m:
            _check_size("size_m", edge)


Obstacle = Sphere | Cylinder | Box
"""What the path tracers know."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """A black body of triangles. corners_m: [v, 3] points. faces: [f, 3] indices of corners; either side is solid."""

    corners_m: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]

    def __post_init__(self) -> None:
        if not np.isfinite(self.corners_m).all():
            raise ValueError("mesh corners must be finite")
        if not len(self.faces) or self.faces.min() < 0 or self.faces.max() >= len(self.corners_m):
            raise ValueError(f"mesh faces must name corners 0 to {len(self.corners_m) - 1}, and there must be some")


Solid = Obstacle | Mesh


def _check_finite(name: str, vector: Vector) -> None:
    if len(vector) != 3 or not all(map(math.isfinite, vector)):
        raise ValueError(f"{name} {vector} must be three finite numbers")


def _check_size(name: str, size_m: float) -> None:
    if not (math.isfinite(size_m) and size_m > 0.0):
        raise ValueError(f"{name} {size_m} m must be positive and finite")
