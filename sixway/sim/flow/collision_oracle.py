"""NumPy float64 twins of `sixway.sim.flow.collision`, written from the equations in tensors and moment matrices.

Populations [q, ...] as g = f - w, vectors [3, ...]; the cells' axes are any.
"""

from itertools import product

import numpy as np
from jaxtyping import Float

from sixway.sim.flow.lattice import CollisionModel, Lattice

Populations = Float[np.ndarray, "q *cells"]
Vector = Float[np.ndarray, "3 *cells"]
Scalar = Float[np.ndarray, "*cells"]
Tensor = Float[np.ndarray, "3 3 *cells"]


def collide(
    lattice: Lattice, model: CollisionModel, g: Populations, acceleration: Vector, *, tau: float, smagorinsky: float
) -> tuple[Populations, Scalar, Vector]:
    """Populations after collision, density, and velocity in the middle of the step."""
    w = lattice.weights.reshape(-1, *[1] * (g.ndim - 1))
    f = g.astype(np.float64) + w
    density, u, stress = moments(lattice, f, acceleration)
    rate = 1.0 / eddy_relaxation_time(tau, smagorinsky, stress, density)
    if model == "bgk":
        resting = _second_order(lattice, density, u)
        after = f - rate * (f - resting) + (1.0 - 0.5 * rate) * _force(lattice, u, density * acceleration)
    else:
        velocity, relaxed = relax(density, u, stress, acceleration, rate)
        rebuild = third_order if model == "third_order" else central_hermite
        after = rebuild(lattice, density, velocity, relaxed)
    return after - w, density, u


def moments(lattice: Lattice, f: Populations, acceleration: Vector) -> tuple[Scalar, Vector, Tensor]:
    """Density, velocity with half of the force, and sum (c - u)(c - u) f - rho / 3."""
    density = f.sum(axis=0)
    u = np.einsum("qa,q...->a...", lattice.velocities, f) / density + 0.5 * acceleration
    return density, u, _central(lattice, f, u) - _diagonal(density / 3.0)


def eddy_relaxation_time(tau: float, smagorinsky: float, stress: Tensor, density: Scalar) -> Scalar:
    """tau + 3 (Cs^2 |S|), S itself depending on the result: its quadratic solved (Hou et al. 1996)."""
    norm = np.sqrt((stress**2).sum(axis=(0, 1)))
    return 0.5 * (tau + np.sqrt(tau**2 + 18.0 * np.sqrt(2.0) * smagorinsky**2 * norm / density))


def relax(density: Scalar, u: Vector, stress: Tensor, acceleration: Vector, rate: Scalar) -> tuple[Vector, Tensor]:
    """Velocity at the end of the step, and about it the stress: sheared part relaxed, trace gone."""
    v = u + 0.5 * acceleration
    trace = np.einsum("aa...->...", stress)
    sheared = (1.0 - rate) * (stress - _diagonal(trace / 3.0))
    return v, sheared - density * (v - u) * (v - u)[:, None]


def central_hermite(lattice: Lattice, density: Scalar, v: Vector, stress: Tensor) -> Populations:
    """The f whose Hermite moments about v are density, 0, stress, and 0 from the third order on: a linear system.

    One moment a population: powers 0, 1, 2 of x, y, z; D3Q19, without corners, has none of x, y and z together.
    """
    orders = [n for n in product(range(3), repeat=3) if len(lattice.weights) == 27 or 0 in n]
    relative = lattice.velocities[(...,) + (None,) * density.ndim] - v  # [q, 3, ...]
    one_axis = np.stack([np.ones_like(relative), relative, relative**2 - 1.0 / 3.0])  # [power, q, 3, ...]
    matrix = np.stack([one_axis[x, :, 0] * one_axis[y, :, 1] * one_axis[z, :, 2] for x, y, z in orders])
    wanted = np.zeros((len(orders), *density.shape))
    for row, n in enumerate(orders):
        axes = [axis for axis, power in enumerate(n) for _ in range(power)]
        if len(axes) == 0:
            wanted[row] = density
        elif len(axes) == 2:
            wanted[row] = stress[axes[0], axes[1]]
    by_cell = np.moveaxis(matrix, (0, 1), (-2, -1)), np.moveaxis(wanted, 0, -1)[..., None]
    return np.moveaxis(np.linalg.solve(*by_cell)[..., 0], -1, 0)


def third_order(lattice: Lattice, density: Scalar, v: Vector, stress: Tensor) -> Populations:
    """w (rho + 3 a1.c + 9/2 a2:H2 + 9/2 a3:H3), a3 = rho vvv + the three v stress (Li et al. 2023)."""
    c, eye = lattice.velocities.astype(np.float64), np.eye(3)
    w = lattice.weights
    a2 = density * v * v[:, None] + stress
    mixed = np.einsum("a...,bd...->abd...", v, stress)
    a3 = density * np.einsum("a...,b...,d...->abd...", v, v, v)
    a3 = a3 + mixed + np.moveaxis(mixed, 0, 1) + np.moveaxis(mixed, 0, 2)
    h2 = np.einsum("qa,qb->qab", c, c) - eye / 3.0
    ceye = np.einsum("qa,bd->qabd", c, eye)
    h3 = np.einsum("qa,qb,qd->qabd", c, c, c) - (ceye + np.moveaxis(ceye, 1, 2) + np.moveaxis(ceye, 1, 3)) / 3.0
    return (
        np.multiply.outer(w, density)
        + 3.0 * np.einsum("q,qa,a...->q...", w, c, density * v)
        + 4.5 * np.einsum("q,qab,ab...->q...", w, h2, a2)
        + 4.5 * np.einsum("q,qabd,abd...->q...", w, h3, a3)
    )


def _central(lattice: Lattice, f: Populations, u: Vector) -> Tensor:
    relative = lattice.velocities[(...,) + (None,) * (f.ndim - 1)] - u
    return np.einsum("qa...,qb...,q...->ab...", relative, relative, f)


def _second_order(lattice: Lattice, density: Scalar, u: Vector) -> Populations:
    """The Maxwellian to second order in u (Krueger et al. 2017, Eq. 3.4)."""
    cu = np.einsum("qa,a...->q...", lattice.velocities, u)
    return np.einsum(
        "q,q...->q...", lattice.weights, density * (1.0 + 3.0 * cu + 4.5 * cu**2 - 1.5 * (u**2).sum(axis=0))
    )


def _force(lattice: Lattice, u: Vector, force: Vector) -> Populations:
    """Guo, Zheng & Shi 2002, Eq. 20, without its factor 1 - 1 / (2 tau)."""
    relative = lattice.velocities[(...,) + (None,) * (u.ndim - 1)] - u
    cu = np.einsum("qa,a...->q...", lattice.velocities, u)
    cf = np.einsum("qa,a...->q...", lattice.velocities, force)
    return np.einsum(
        "q,q...->q...", lattice.weights, 3.0 * np.einsum("qa...,a...->q...", relative, force) + 9.0 * cu * cf
    )


def _diagonal(value: Scalar) -> Tensor:
    return np.multiply.outer(np.eye(3), value)
