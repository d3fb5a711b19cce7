"""Solid bodies that stand or move in the smoke, each by its signed distance."""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from jaxtyping import Float
from pydantic import Field, ValidationInfo, field_validator, model_validator
from scipy.spatial.transform import Rotation

from sixway.core.config import Config
from sixway.core.frames import Grid
from sixway.sim.bodies.meshes import Surface, read_surface
from sixway.sim.bodies.motion import AT_REST, Motion, Pose, Position, Turn
from sixway.sim.units import LatticeUnits

Length = Annotated[float, Field(gt=0.0, le=1000.0)]
Axis = Annotated[float, Field(ge=-1.0, le=1.0)]

ENDLESS_M = 1e5
"""Half the length of a cylinder that reaches from wall to wall [m]: beyond any box."""

FASTEST_WALL = 0.25
"""Speed above which a moving surface is refused [cells/step]: Mach 0.43, past what the lattice can follow."""


class Body(Config):
    """What all bodies have. Body axes are those in which the shape is described, with its centre at 0."""

    centre_m: Position
    """[m]"""
    motion: Motion | None = None
    """How it moves; it stands still by default."""

    @property
    @abstractmethod
    def half_extent_m(self) -> Float[np.ndarray, "3"]:
        """Half the edges of its bounds along body axes [m]."""

    @abstractmethod
    def distance_in_body(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Distance to the surface [m], negative inside, of points in body axes."""

    @property
    def rest_rotation(self) -> Float[np.ndarray, "3 3"]:
        """Body axes to world axes before any motion."""
        return np.eye(3)

    def pose(self, time_s: float) -> Pose:
        """Its pose relative to its place at rest."""
        return AT_REST if self.motion is None else self.motion.pose(time_s)

    def placement(self, time_s: float) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """World position of its centre [m] and the rotation from body axes to world axes."""
        pose = self.pose(time_s)
        return np.array(self.centre_m) + pose.offset_m, pose.rotation @ self.rest_rotation

    def signed_distance(self, points_m: Float[np.ndarray, "*n 3"], time_s: float = 0.0) -> Float[np.ndarray, "*n"]:
        """Distance to the surface [m], negative inside, of world points at a time."""
        centre, rotation = self.placement(time_s)
        return self.distance_in_body((points_m - centre) @ rotation)

    def bounds_m(self, time_s: float) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Lowest and highest corner [m] of a world-aligned box around it at a time."""
        centre, rotation = self.placement(time_s)
        low, high = self.reach_m(rotation)
        return centre + low, centre + high

    def reach_m(self, rotation: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """How far it reaches from its centre down and up each world axis [m], turned by `rotation`."""
        reach = np.abs(rotation) @ self.half_extent_m
        return -reach, reach


class SphereBody(Body):
    """A ball."""

    kind: Literal["sphere"]
    radius_m: Length
    """[m]"""

    @property
    def half_extent_m(self) -> Float[np.ndarray, "3"]:
        return np.full(3, self.radius_m)

    def reach_m(self, rotation: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        return -self.half_extent_m, self.half_extent_m  # a ball looks the same however it turns

    def distance_in_body(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        return np.linalg.norm(points_m, axis=-1) - self.radius_m


class Upright(Body):
    """A body that is round about an axis: body z."""

    axis: Literal["x", "y", "z"] | tuple[Axis, Axis, Axis] = "z"
    """A world axis, or a direction (x, y, z) of any length, that it runs along at rest."""
    radius_m: Length
    """[m]"""

    @model_validator(mode="after")
    def _points_somewhere(self) -> Self:
        if not isinstance(self.axis, str) and np.linalg.norm(self.axis) < 1e-3:
            raise ValueError(f"axis={self.axis} has no length; give it a component such as (0, 1, 0), or a letter")
        return self

    @property
    def rest_rotation(self) -> Float[np.ndarray, "3 3"]:
        along = np.eye(3)["xyz".index(self.axis)] if isinstance(self.axis, str) else np.array(self.axis)
        along = along / np.linalg.norm(along)
        across = np.cross(np.eye(3)[np.argmin(np.abs(along))], along)
        across /= np.linalg.norm(across)
        return np.stack([across, np.cross(along, across), along], axis=1)


class CylinderBody(Upright):
    """A cylinder, from wall to wall unless it has a length."""

    kind: Literal["cylinder"]
    length_m: Length | None = None
    """Between its flat ends [m], half to either side of the centre; none: it reaches from wall to wall."""

    @property
    def half_extent_m(self) -> Float[np.ndarray, "3"]:
        half = ENDLESS_M if self.length_m is None else 0.5 * self.length_m
        return np.array([self.radius_m, self.radius_m, half])

    def reach_m(self, rotation: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        along = np.abs(rotation[:, 2])
        reach = self.half_extent_m[2] * along + self.radius_m * np.sqrt(np.maximum(1.0 - along**2, 0.0))
        return -reach, reach

    def distance_in_body(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        radial = np.linalg.norm(points_m[..., :2], axis=-1) - self.radius_m
        along = np.abs(points_m[..., 2]) - self.half_extent_m[2]
        return _distance_to_box(np.stack([radial, along], axis=-1))


class CapsuleBody(Upright):
    """A cylinder with round ends."""

    kind: Literal["capsule"]
    length_m: Length
    """Between the centres of its two round ends [m]; its whole length is 2 radius_m more."""

    @property
    def half_extent_m(self) -> Float[np.ndarray, "3"]:
        return self.radius_m + np.array([0.0, 0.0, 0.5 * self.length_m])

    def reach_m(self, rotation: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        reach = self.radius_m + 0.5 * self.length_m * np.abs(rotation[:, 2])
        return -reach, reach

    def distance_in_body(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        beyond = np.maximum(np.abs(points_m[..., 2]) - 0.5 * self.length_m, 0.0)
        return np.hypot(np.linalg.norm(points_m[..., :2], axis=-1), beyond) - self.radius_m


class BoxBody(Body):
    """A box."""

    kind: Literal["box"]
    size_m: tuple[Length, Length, Length]
    """Its edges along body x, y, z [m]."""
    rotation_deg: Turn = (0.0, 0.0, 0.0)
    """How it is turned at rest."""

    @property
    def rest_rotation(self) -> Float[np.ndarray, "3 3"]:
        return Rotation.from_rotvec(self.rotation_deg, degrees=True).as_matrix()

    @property
    def half_extent_m(self) -> Float[np.ndarray, "3"]:
        return 0.5 * np.array(self.size_m)

    def distance_in_body(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        return _distance_to_box(np.abs(points_m) - self.half_extent_m)


class MeshBody(Body):
    """A triangle mesh from a file, the centre of its bounds at `centre_m`.

    It need not be watertight: inside is where the winding number exceeds 1/2. Raises ValueError for a file that
    `meshes.read_surface` refuses.
    """

    kind: Literal["mesh"]
    path: str = Field(min_length=1, max_length=4096)
    """An .obj, .stl or .ply file; relative to the config file's folder, absolute once the config is read."""
    size_m: Length
    """Longest edge of its bounds along the file's axes [m], whatever units the file counts in."""
    up: Literal["x", "y", "z"] = "y"
    """The file's axis that points up."""
    rotation_deg: Turn = (0.0, 0.0, 0.0)
    """How it is turned at rest, once it stands upright."""
    resolution: int = Field(default=64, ge=16, le=256)
    """Samples of its distance field along its longest edge: finer detail is rounded off."""

    @field_validator("path")
    @classmethod
    def _in_folder(cls, path: str, info: ValidationInfo) -> str:
        folder = (info.context or {}).get("folder")
        return path if folder is None else str((Path(folder) / path).resolve())

    @model_validator(mode="after")
    def _is_readable(self) -> Self:
        read_surface(Path(self.path))
        return self

    @property
    def surface(self) -> Surface:
        """The file's triangles, centred, with a longest edge of 1."""
        return read_surface(Path(self.path))

    @property
    def rest_rotation(self) -> Float[np.ndarray, "3 3"]:
        upright = {"x": (0.0, 0.0, 90.0), "y": (0.0, 0.0, 0.0), "z": (-90.0, 0.0, 0.0)}[self.up]
        turn = Rotation.from_rotvec(self.rotation_deg, degrees=True)
        return (turn * Rotation.from_rotvec(upright, degrees=True)).as_matrix()

    @property
    def half_extent_m(self) -> Float[np.ndarray, "3"]:
        return self.size_m * self.surface.half_extent

    def reach_m(self, rotation: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        hull = self.size_m * self.surface.hull @ rotation.T
        return hull.min(axis=0), hull.max(axis=0)

    def distance_in_body(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        flat = np.reshape(points_m, (-1, 3)) / self.size_m
        return np.reshape(self.surface.signed_distance(flat) * self.size_m, points_m.shape[:-1])


ObstacleConfig = Annotated[CylinderBody | SphereBody | BoxBody | CapsuleBody | MeshBody, Field(discriminator="kind")]


def nearest_approach(
    bodies: Sequence[Body], points_m: Float[np.ndarray, "n 3"], *, times_s: Sequence[float], within_m: float
) -> tuple[float, float]:
    """Smallest signed distance [m] between the points and any body at the times, and when that was [s].

    Infinite, and at the first time, if no body's bounds come within `within_m` of a point.
    """
    nearest, when = np.inf, times_s[0]
    for body in bodies:
        for time_s in times_s if body.motion is not None else times_s[:1]:
            low, high = body.bounds_m(time_s)
            near = points_m[np.all((points_m > low - within_m) & (points_m < high + within_m), axis=-1)]
            if len(near) and (gap := float(body.signed_distance(near, time_s).min())) < nearest:
                nearest, when = gap, time_s
    return nearest, when


def surface_speed_m_s(body: Body, time_s: float, *, within_m: float) -> float:
    """Speed [m/s] of the fastest corner of its bounds, which no point of it exceeds.

    A ball may stay 1.7 times below. Ends beyond `within_m` of the centre do not count.
    """
    pose = body.pose(time_s)
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    arms = corners * np.minimum(body.half_extent_m, within_m)
    world = arms @ (pose.rotation @ body.rest_rotation).T
    return float(np.linalg.norm(pose.velocity_m_s + np.cross(pose.spin_rad_s, world), axis=-1).max())


def check_bodies(bodies: Sequence[Body], *, grid: Grid, units: LatticeUnits, times_s: Sequence[float]) -> None:
    """Refuse bodies that the velocity `grid` cannot carry at one of the times (those of the frames).

    A body may cross a wall of the box. Raises ValueError, naming the body, the time, the rule and the remedy, for
    one that lies wholly outside, that is thinner than three cells, or whose surface outruns `FASTEST_WALL`.
    """
    low, cell_m = np.array(grid.origin_m), grid.voxel_size_m
    high = low + np.array(grid.extent_m)
    for number, body in enumerate(bodies):
        thinnest = 2.0 * float(body.half_extent_m.min())
        if thinnest < 3.0 * cell_m * (1 - 1e-9):
            raise ValueError(
                f"obstacles.{number}: is {thinnest:.4g} m thick, below 3 velocity cells of {cell_m:.4g} m; make it "
                f"at least {3.0 * cell_m:.4g} m or raise cells_xyz"
            )
        for time_s in times_s if body.motion is not None else times_s[:1]:
            bottom, top = body.bounds_m(time_s)
            if np.any(top <= low) or np.any(bottom >= high):
                raise ValueError(
                    f"obstacles.{number}: lies outside the box at {time_s:.4g} s, with its centre at "
                    f"{_text(body.placement(time_s)[0])} m; the box reaches from {_text(low)} to {_text(high)} m: "
                    "move it in, slow it down or end the run earlier"
                )
            speed = units.velocity_to_lattice(surface_speed_m_s(body, time_s, within_m=2.0 * grid.radius_m))
            if speed > FASTEST_WALL:
                raise ValueError(
                    f"obstacles.{number}: its surface moves at {speed:.3g} cells/step at {time_s:.4g} s; at most "
                    f"{FASTEST_WALL} is stable: slow it down {speed / FASTEST_WALL:.3g} times or lower lattice_speed"
                )


def _distance_to_box(beyond: Float[np.ndarray, "*n d"]) -> Float[np.ndarray, "*n"]:
    """Signed distance to a box from |x| - half of each axis."""
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


def _text(point_m: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point_m) + ")"
