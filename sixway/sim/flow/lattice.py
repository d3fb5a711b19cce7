"""Discrete velocity sets (lattices) as data (Krueger et al. 2017, Tables 3.4, 3.6), in lattice units: cells and steps.

Velocities stand in opposite pairs behind the rest velocity, and D3Q27 begins like D3Q19. The kernels compile
these very tables in, the oracles read them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

LatticeName = Literal["D3Q19", "D3Q27"]
CollisionModel = Literal["bgk", "regularised", "third_order"]


@dataclass(frozen=True, eq=False)
class Lattice:
    """One velocity set of q populations."""

    name: LatticeName
    velocities: np.ndarray
    """c_q, [q, 3] integers (x, y, z): cells that population q moves in one step."""
    weights: np.ndarray
    """w_q, [q]: the populations of a fluid of density 1 at rest."""
    opposite: np.ndarray
    """Index of -c_q, [q]: where a wall sends population q back to."""

    def mirrored(self, axes: Sequence[bool]) -> np.ndarray:
        """Index of c_q with the components of the chosen axes (x, y, z) reflected, [q]."""
        reflected = self.velocities * np.where(axes, -1, 1)
        return np.array([np.flatnonzero((self.velocities == c).all(axis=1))[0] for c in reflected])


_REST, _FACES = [(0, 0, 0)], [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
_EDGES = [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
_CORNERS = [(1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)]


def _lattice(name: LatticeName, half: list[tuple[int, int, int]], weights: list[float]) -> Lattice:
    velocities = np.array(_REST + [v for c in half for v in (c, tuple(-part for part in c))])
    opposite = np.array([0, *[q + 1 if q % 2 else q - 1 for q in range(1, len(velocities))]])
    return Lattice(name, velocities, np.array(weights), opposite)


D3Q19 = _lattice("D3Q19", _FACES + _EDGES, [1 / 3] + 6 * [1 / 18] + 12 * [1 / 36])
D3Q27 = _lattice("D3Q27", _FACES + _EDGES + _CORNERS, [8 / 27] + 6 * [2 / 27] + 12 * [1 / 54] + 8 * [1 / 216])

SOUND_SPEED = 3.0**-0.5
"""c_s [cells/step]; the model holds for speeds well below it."""

FLUID, SOLID, OPEN, INLET = 0, 1, 2, 3
"""Kinds of cell. SOLID bounces populations back half-way, off a wall that may move. OPEN is the air outside, at
density 1. INLET has its velocity imposed."""

IMAGE = 8
"""A ghost cell that stands for another: for its mirror in slip sides (IMAGE + 1, + 2, + 4 for x, y, z), for the
one on the other side where sides are periodic (+ 16, + 32, + 64). The other one may be of the shell too, where these
sides meet walls, open sides or inlets."""


def lattice_named(name: LatticeName) -> Lattice:
    """D3Q19, a cube's faces and edges, or D3Q27, its corners too."""
    match name:
        case "D3Q19":
            return D3Q19
        case "D3Q27":
            return D3Q27


def relaxation_time(viscosity: float) -> float:
    """tau [steps] of a kinematic viscosity [cells^2/step]: nu = c_s^2 (tau - 1/2) (Krueger et al., Eq. 3.5)."""
    return 0.5 + 3.0 * viscosity
