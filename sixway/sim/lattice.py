"""The D3Q19 velocity set as data (Qian, d'Humieres & Lallemand 1992; Krueger et al. 2017, Table 3.4).

Velocities stand in opposite pairs behind the rest velocity. Everything is in lattice units: cells and
steps. `sixway.sim.kernels` compiles these very tables in, `sixway.sim.oracle` reads them.
"""

import numpy as np

VELOCITIES = np.array(
    [
        (0, 0, 0),
        *[(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)],
        *[(1, 1, 0), (-1, -1, 0), (1, -1, 0), (-1, 1, 0)],
        *[(1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1)],
        *[(0, 1, 1), (0, -1, -1), (0, 1, -1), (0, -1, 1)],
    ]
)
"""c_q, [19, 3] integers (x, y, z): cells that population q moves in one step."""

WEIGHTS = np.array([1 / 3] + 6 * [1 / 18] + 12 * [1 / 36])
"""w_q, [19]: the populations of a fluid of density 1 at rest."""

OPPOSITE = np.array([0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15, 18, 17])
"""Index of -c_q: where a wall sends population q back to."""

SOUND_SPEED = 3.0**-0.5
"""c_s [cells/step]; the model holds for speeds well below it."""

FLUID, SOLID, OPEN, INLET = 0, 1, 2, 3
"""Kinds of cell. SOLID bounces populations back half-way, OPEN is still air at density 1, INLET has its
velocity imposed. The lattice itself is periodic: a shell of SOLID and OPEN cells closes a box."""


def relaxation_time(viscosity: float) -> float:
    """tau [steps] of a kinematic viscosity [cells^2/step]: nu = c_s^2 (tau - 1/2) (Krueger et al., Eq. 3.5)."""
    return 0.5 + 3.0 * viscosity
