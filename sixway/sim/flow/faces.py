"""What closes the box of the flow on each side."""

from typing import Literal, get_args

import numpy as np
from pydantic import model_validator

from sixway.core.config import Config
from sixway.sim.flow.lattice import FLUID, IMAGE, OPEN, SOLID, SOUND_SPEED


class MovingWall(Config):
    """A wall that slides in its own plane: velocity (x, y, z) [cells/step]."""

    velocity: tuple[float, float, float]


Side = Literal["x_low", "x_high", "y_low", "y_high", "z_low", "z_high"]
"""A side of the box; `low` is that of index 0."""

SIDES: tuple[Side, ...] = get_args(Side)


def opposite(side: Side) -> Side:
    """The side across the box."""
    return SIDES[SIDES.index(side) ^ 1]


Face = Literal["wall", "slip", "periodic", "open"] | MovingWall


class Faces(Config):
    """What closes the box on each side; `low` is the side of index 0.

    wall: no slip. slip: no friction, nothing passes. periodic: what leaves comes back on the other side. open: air
    at density 1. Where two of them meet, wall goes before moving wall before open; what a slip side mirrors or a
    periodic one repeats are the other sides too.
    """

    x_low: Face = "wall"
    x_high: Face = "wall"
    y_low: Face = "wall"
    y_high: Face = "wall"
    z_low: Face = "wall"
    z_high: Face = "wall"

    @property
    def pairs(self) -> tuple[tuple[Face, Face], ...]:
        """(low, high) of x, y, z."""
        return (self.x_low, self.x_high), (self.y_low, self.y_high), (self.z_low, self.z_high)

    def check_inlets(self, inlet: np.ndarray) -> None:
        """ValueError if one of the cells [z, y, x], with shell, is in a periodic side: the other would not know."""
        for axis, (letter, pair) in enumerate(zip("xyz", self.pairs, strict=True)):
            for side, end, face in zip(("low", "high"), (0, -1), pair, strict=True):
                if face == "periodic" and inlet[_layer(axis, end)][1:-1, 1:-1].any():
                    raise ValueError(
                        f"{letter}_{side} is periodic and has an inlet: what leaves on the other side would meet it; "
                        f"put the inlet into the box, or make both sides of {letter} something else"
                    )

    @model_validator(mode="after")
    def _can_be_honoured(self) -> "Faces":
        for axis, (letter, pair) in enumerate(zip("xyz", self.pairs, strict=True)):
            if "periodic" in pair and pair[0] != pair[1]:
                raise ValueError(
                    f"{letter}_low={pair[0]!r}, {letter}_high={pair[1]!r}: periodic sides come in pairs; "
                    f"make both sides of {letter} periodic, or neither"
                )
            for side, face in zip(("low", "high"), pair, strict=True):
                if isinstance(face, MovingWall):
                    _check_sliding(f"{letter}_{side}", face, axis)
        return self


def _check_sliding(name: str, wall: MovingWall, axis: int) -> None:
    speed = float(np.linalg.norm(wall.velocity))
    if wall.velocity[axis] != 0.0:
        raise ValueError(
            f"{name} moves by {wall.velocity[axis]} along its normal: a side of the box slides in its own plane; "
            f"set its component {'xyz'[axis]} to 0, or let air through with an inlet"
        )
    if not speed < 0.5 * SOUND_SPEED:
        raise ValueError(
            f"{name} moves at {speed:.3g} cells/step: a wall stays below {0.5 * SOUND_SPEED:.3g}, half the speed of "
            "sound; take more steps per frame"
        )


def _layer(axis: int, end: int) -> tuple[slice | int, ...]:
    """One side of the shell of an array [z, y, x]; axis: 0 for x."""
    return tuple(end if axis == 2 - a else slice(None) for a in range(3))


def close_box(faces: Faces, shape_zyx: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """A box of FLUID in its shell: kind int32 [z + 2, y + 2, x + 2] and the velocity of its walls [..., 3]."""
    kind = np.full([n + 2 for n in shape_zyx], FLUID, dtype=np.int32)
    velocity = np.zeros((*kind.shape, 3), dtype=np.float32)
    sides = [(axis, end, pair[end]) for axis, pair in enumerate(faces.pairs) for end in (0, -1)]

    for axis, end, face in sides:
        if face == "open":
            kind[_layer(axis, end)] = OPEN
    for axis, end, face in sides:
        if isinstance(face, MovingWall):
            kind[_layer(axis, end)], velocity[_layer(axis, end)] = SOLID, face.velocity
    for axis, end, face in sides:
        if face == "wall":
            kind[_layer(axis, end)], velocity[_layer(axis, end)] = SOLID, 0.0
    image = np.zeros_like(kind)
    for axis, end, face in sides:
        if face == "slip":
            image[_layer(axis, end)] |= IMAGE | 1 << axis
        elif face == "periodic":
            image[_layer(axis, end)] |= IMAGE | 16 << axis
    return np.where(image, image, kind), velocity
