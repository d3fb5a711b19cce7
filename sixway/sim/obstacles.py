"""Solid shapes that stand in the smoke, each by its signed distance."""

from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sixway.core.config import Config
from sixway.core.frames import Grid

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
"""A world position (x, y, z) [m]; the box is centred on the origin."""


class Cylinder(Config):
    """A cylinder that reaches from wall to wall."""

    kind: Literal["cylinder"]
    axis: Literal["x", "y", "z"] = "z"
    """World axis that it runs along."""
    centre_m: Position
    """A point on its axis [m]; the coordinate along the axis does not matter."""
    radius_m: float = Field(gt=0.0, le=100.0)
    """[m]"""

    def signed_distance(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Distance to the surface [m], negative inside."""
        across = [component for component in range(3) if component != "xyz".index(self.axis)]
        offset = points_m[..., across] - np.array(self.centre_m)[across]
        return np.linalg.norm(offset, axis=-1) - self.radius_m


class Sphere(Config):
    """A ball."""

    kind: Literal["sphere"]
    centre_m: Position
    """[m]"""
    radius_m: float = Field(gt=0.0, le=100.0)
    """[m]"""

    def signed_distance(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Distance to the surface [m], negative inside."""
        return np.linalg.norm(points_m - np.array(self.centre_m), axis=-1) - self.radius_m


Obstacle = Annotated[Cylinder | Sphere, Field(discriminator="kind")]


def distance_to_all(
    obstacles: tuple[Cylinder | Sphere, ...], points_m: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n"]:
    """Signed distance [m] to the union; infinite where there is no obstacle at all."""
    nearest = np.full(points_m.shape[:-1], np.inf)
    for obstacle in obstacles:
        nearest = np.minimum(nearest, obstacle.signed_distance(points_m))
    return nearest


def voxel_centres(grid: Grid) -> Float[np.ndarray, "z y x 3"]:
    """World positions (x, y, z) [m] of every voxel's centre, float64."""
    z, y, x = (np.arange(n) + 0.5 for n in grid.shape_zyx)
    ijk = np.stack(np.broadcast_arrays(x[None, None, :], y[None, :, None], z[:, None, None]), axis=-1)
    return np.array(grid.origin_m) + ijk * grid.voxel_size_m


def solid_fraction(obstacles: tuple[Cylinder | Sphere, ...], grid: Grid) -> Float[np.ndarray, "z y x"]:
    """Part of each voxel that is solid, float32 in [0, 1]: a ramp one voxel wide across the surface."""
    distance = distance_to_all(obstacles, voxel_centres(grid)) / grid.voxel_size_m
    return np.clip(0.5 - distance, 0.0, 1.0).astype(np.float32)
