"""How solid bodies move: rigidly at a constant rate, or along keyframes."""

from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator
from scipy.interpolate import CubicHermiteSpline, PPoly
from scipy.spatial.transform import Rotation

from sixway.core.config import Config

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
"""A world position or displacement (x, y, z) [m]; the box is centred on the origin."""

Angle = Annotated[float, Field(ge=-36_000.0, le=36_000.0)]
Turn = tuple[Angle, Angle, Angle]
"""A rotation vector (x, y, z) [degrees]: turns about its direction, counter-clockwise seen from its tip, by as
many degrees as it is long. [0, 90, 0] is a quarter turn about y."""

Moment = Annotated[float, Field(ge=0.0, le=100_000.0)]


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Where a moving body is and how it moves, in world axes, relative to where it stands at rest.

    offset_m: how far its centre has moved. rotation: how it has turned about its centre, 3x3.
    velocity_m_s: of its centre. spin_rad_s: angular velocity omega; the point at r from the centre moves
    with velocity + omega x r.
    """

    offset_m: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    velocity_m_s: Float[np.ndarray, "3"]
    spin_rad_s: Float[np.ndarray, "3"]


AT_REST = Pose(offset_m=np.zeros(3), rotation=np.eye(3), velocity_m_s=np.zeros(3), spin_rad_s=np.zeros(3))


class RigidMotion(Config):
    """A constant velocity and a constant spin about the body's centre."""

    kind: Literal["rigid"]
    velocity_m_s: Position = (0.0, 0.0, 0.0)
    """[m/s]"""
    spin_deg_s: Turn = (0.0, 0.0, 0.0)
    """Turns about the direction of this vector, by as many degrees a second as it is long."""

    def pose(self, time_s: float) -> Pose:
        """The pose `time_s` after the inlets opened."""
        velocity, spin = np.array(self.velocity_m_s), np.deg2rad(self.spin_deg_s)
        return Pose(
            offset_m=time_s * velocity,
            rotation=Rotation.from_rotvec(time_s * spin).as_matrix(),
            velocity_m_s=velocity,
            spin_rad_s=spin,
        )


class Keyframes(Config):
    """A path through offsets and turns given at some times.

    `smooth` is a cubic Hermite curve with the slopes (x[n+1] - x[n-1]) / (t[n+1] - t[n-1]): Catmull-Rom for
    evenly spaced times. Velocities are its exact derivative, so they are continuous; at the ends of a held
    path they are zero. `straight` moves at a constant rate between keys and changes its velocity at once.
    Turns are interpolated as rotation vectors: several full turns about one axis are possible.
    Raises ValueError for times that do not rise, lists of unequal length, and a loop that does not close.
    """

    kind: Literal["keyframes"]
    times_s: tuple[Moment, ...] = Field(min_length=2, max_length=1000)
    """Times of the keys [s] since the inlets opened, rising."""
    offsets_m: tuple[Position, ...] = Field(default=(), max_length=1000)
    """How far from `centre_m` the centre is at each key [m]; none: it stays there."""
    turns_deg: tuple[Turn, ...] = Field(default=(), max_length=1000)
    """How far the body has turned about its centre at each key; none: it does not turn."""
    between: Literal["smooth", "straight"] = "smooth"
    after: Literal["hold", "loop"] = "hold"
    """What follows the last key: rest, or the first one again."""

    @model_validator(mode="after")
    def _keys_fit(self) -> Self:
        keys = len(self.times_s)
        for name in ("offsets_m", "turns_deg"):
            given = len(getattr(self, name))
            if given not in (0, keys):
                raise ValueError(f"{name} has {given} entries for {keys} times_s; give one for each time or none")
        rises = np.diff(self.times_s)
        if np.any(rises < 1e-6):
            n = int(np.argmin(rises))
            raise ValueError(
                f"times_s must rise by at least 1e-6 s, got {self.times_s[n]} before {self.times_s[n + 1]}; sort them"
            )
        if self.after == "loop":
            gap = float(np.abs(self._offsets[-1] - self._offsets[0]).max())
            first, last = Rotation.from_rotvec(self._turns[[0, -1]])
            angle = float((first.inv() * last).magnitude())
            if gap > 1e-6 or angle > 1e-6:
                raise ValueError(
                    f"a loop ends where it began, but the last key is {gap:g} m and {np.rad2deg(angle):g} degrees "
                    "away from the first; repeat the first key at the end or use after: hold"
                )
        return self

    def pose(self, time_s: float) -> Pose:
        """The pose `time_s` after the inlets opened."""
        first, last = self.times_s[0], self.times_s[-1]
        if self.after == "loop":
            within = first + (time_s - first) % (last - first)
        else:
            within = min(max(time_s, first), last)
        resting = self.after == "hold" and not first <= time_s < last
        offset, offset_rate = self._follow(self._offsets, within)
        turn, turn_rate = self._follow(self._turns, within)
        return Pose(
            offset_m=offset,
            rotation=Rotation.from_rotvec(turn).as_matrix(),
            velocity_m_s=np.zeros(3) if resting else offset_rate,
            spin_rad_s=np.zeros(3) if resting else left_jacobian(turn) @ turn_rate,
        )

    @property
    def _offsets(self) -> Float[np.ndarray, "k 3"]:
        return np.array(self.offsets_m) if self.offsets_m else np.zeros((len(self.times_s), 3))

    @property
    def _turns(self) -> Float[np.ndarray, "k 3"]:
        """Rotation vectors [rad]."""
        return np.deg2rad(self.turns_deg) if self.turns_deg else np.zeros((len(self.times_s), 3))

    def _follow(self, keys: np.ndarray, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Value and rate at a time within the keys."""
        times = np.array(self.times_s)
        if self.between == "straight":
            rates = np.diff(keys, axis=0) / np.diff(times)[:, None]
            curve = PPoly(np.stack([rates, keys[:-1]]), times)
        else:
            curve = CubicHermiteSpline(times, keys, self._slopes(times, keys))
        return curve(time_s), curve(time_s, 1)

    def _slopes(self, times: np.ndarray, keys: np.ndarray) -> np.ndarray:
        slopes = np.zeros_like(keys)
        slopes[1:-1] = (keys[2:] - keys[:-2]) / (times[2:] - times[:-2])[:, None]
        if self.after == "loop":  # the key before the first is the last but one
            whole = (keys[1] - keys[0]) + (keys[-1] - keys[-2])
            slopes[[0, -1]] = whole / ((times[1] - times[0]) + (times[-1] - times[-2]))
        return slopes


Motion = Annotated[RigidMotion | Keyframes, Field(discriminator="kind")]


def left_jacobian(turn: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """What turns the rate of a rotation vector [rad] into the angular velocity in world axes.

    J = sin(a)/a 1 + (1 - sin(a)/a) n n^T + (1 - cos(a))/a [n]x (Sola et al. 2018, "A micro Lie theory", Eq. 145).
    """
    angle = float(np.linalg.norm(turn))
    if angle < 1e-8:
        return np.eye(3)
    n = turn / angle
    across = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    sinc = np.sin(angle) / angle
    return sinc * np.eye(3) + (1.0 - sinc) * np.outer(n, n) + (1.0 - np.cos(angle)) / angle * across
