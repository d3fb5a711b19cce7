"""NumPy float64 twins of `sixway.sim.kernels`: slow, whole-array, written from the equations.

Layouts and units are those of the kernels: [z, y, x], populations [q, z, y, x] as g = f - w, lattice units.
"""

import numpy as np
from jaxtyping import Float, Int

from sixway.sim.lattice import FLUID, INLET, OPEN, OPPOSITE, SOLID, VELOCITIES, WEIGHTS

Populations = Float[np.ndarray, "19 z y x"]
Velocity = Float[np.ndarray, "z y x 3"]


def equilibrium(density_shift: Float[np.ndarray, "z y x"], u: Velocity) -> Populations:
    """f^eq - w of density 1 + density_shift: the Maxwellian to second order in u."""
    cu = np.einsum("qa,zyxa->qzyx", VELOCITIES, u)
    bracket = 3.0 * cu + 4.5 * cu**2 - 1.5 * np.sum(u**2, axis=-1)
    return WEIGHTS[:, None, None, None] * (density_shift + (1.0 + density_shift) * bracket)


def stream(kind: Int[np.ndarray, "z y x"], g: Populations, u: Velocity) -> Populations:
    """Pull from upwind cells; SOLID ones bounce half-way, OPEN ones send air that keeps only its upward speed."""
    leaving = np.zeros_like(u)
    leaving[..., 1] = np.maximum(u[..., 1], 0.0)
    outside = equilibrium(np.zeros(kind.shape), leaving)
    pulled = np.empty_like(g)
    for q, (x, y, z) in enumerate(VELOCITIES):
        moved = np.roll(g[q], (z, y, x), axis=(0, 1, 2))
        upwind = np.roll(kind, (z, y, x), axis=(0, 1, 2))
        pulled[q] = np.where(upwind == SOLID, g[OPPOSITE[q]], np.where(upwind == OPEN, outside[q], moved))
    return pulled


def collide_and_stream(
    kind: Int[np.ndarray, "z y x"],
    lift: Float[np.ndarray, "z y x"],
    g: Populations,
    velocity: Velocity,
    *,
    tau: float,
    smagorinsky: float,
) -> tuple[Populations, Velocity]:
    """One step of BGK with Smagorinsky and Guo's force: the new populations and velocity."""
    g = g.astype(np.float64)
    pulled = stream(kind, g, velocity)
    shift = pulled.sum(axis=0)
    density = 1.0 + shift
    force = np.zeros((*kind.shape, 3))
    force[..., 1] = lift * density
    u = (np.einsum("qa,qzyx->zyxa", VELOCITIES, pulled) + 0.5 * force) / density[..., None]

    resting = equilibrium(shift, u)
    stress = np.einsum("qa,qb,qzyx->abzyx", VELOCITIES, VELOCITIES, pulled - resting)
    norm = np.sqrt(np.sum(stress**2, axis=(0, 1)))
    tau_eff = 0.5 * (tau + np.sqrt(tau**2 + 18.0 * np.sqrt(2.0) * smagorinsky**2 * norm / density))

    cu = np.einsum("qa,zyxa->qzyx", VELOCITIES, u)
    cf = np.einsum("qa,zyxa->qzyx", VELOCITIES, force)
    push = WEIGHTS[:, None, None, None] * (3.0 * (cf - np.sum(u * force, axis=-1)) + 9.0 * cu * cf)
    collided = pulled - (pulled - resting) / tau_eff + (1.0 - 0.5 / tau_eff) * push

    blown = equilibrium(np.zeros(kind.shape), velocity)
    after = np.where(kind == FLUID, collided, np.where(kind == INLET, blown, g))
    return after, np.where((kind == FLUID)[..., None], u, velocity)


def gusts(
    at: Float[np.ndarray, "n 3"],
    *,
    wave: Float[np.ndarray, "a 3"],
    amplitude: Float[np.ndarray, "a 3"],
    frequency: Float[np.ndarray, "a"],
    phase: Float[np.ndarray, "a"],
    time: float,
) -> Float[np.ndarray, "n 3"]:
    """Sum of Fourier modes at cells (x, y, z): what `kernels.blow` adds to the mean velocity."""
    return np.cos(at @ wave.T + frequency * time + phase) @ amplitude


def trilinear(values: Float[np.ndarray, "z y x *c"], at: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n *c"]:
    """Values at positions (x, y, z) in cells, beyond a face the nearest cell's."""
    base = np.floor(at).astype(int)
    part = at - base
    total = np.zeros((len(at), *values.shape[3:]))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, part, 1.0 - part), axis=1)
        total += weight.reshape(-1, *[1] * (values.ndim - 3)) * _clamped(values, base + corner)
    return total


def clamped_cubic(values: Float[np.ndarray, "z y x"], at: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Catmull-Rom in each axis, then clamped to the eight cells around each position."""
    base = np.floor(at).astype(int)
    part = at - base
    powers = np.stack([np.ones_like(part), part, part**2, part**3], axis=-1)
    basis = 0.5 * np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]])
    weights = powers @ basis
    total = np.zeros(len(at))
    for offset in np.ndindex(4, 4, 4):
        weight = np.prod([weights[:, axis, step] for axis, step in enumerate(offset)], axis=0)
        total += weight * _clamped(values, base + np.array(offset) - 1)
    around = np.stack([_clamped(values, base + corner) for corner in np.ndindex(2, 2, 2)])
    return np.clip(total, around.min(axis=0), around.max(axis=0))


def advect(
    velocity: Velocity,
    source: Float[np.ndarray, "z y x"],
    obstacle: Float[np.ndarray, "z y x"],
    smoke: Float[np.ndarray, "z y x"],
    *,
    refinement: int,
    steps: int,
    cubic: bool,
) -> Float[np.ndarray, "z y x"]:
    """Semi-Lagrangian step of the smoke by `steps` lattice steps, midpoint rule; velocity has its shell."""
    z, y, x = np.indices(smoke.shape).reshape(3, -1)
    p = np.stack([x, y, z], axis=1).astype(np.float64)
    reach = refinement * steps

    def wind(at: np.ndarray) -> np.ndarray:
        return trilinear(velocity, (at + 0.5) / refinement + 0.5)

    departed = p - reach * wind(p - 0.5 * reach * wind(p))
    carried = clamped_cubic(smoke, departed) if cubic else trilinear(smoke, departed)
    carried[departed[:, 1] >= smoke.shape[1] - 0.5] = 0.0
    return np.where(obstacle >= 0.5, 0.0, np.maximum(carried.reshape(smoke.shape), source))


def buoyancy(smoke: Float[np.ndarray, "z y x"], *, refinement: int, strength: float) -> Float[np.ndarray, "cz cy cx"]:
    """Upward acceleration of each velocity cell, without the shell: strength times the mean density."""
    z, y, x = (n // refinement for n in smoke.shape)
    return strength * smoke.reshape(z, refinement, y, refinement, x, refinement).mean(axis=(1, 3, 5))


def _clamped(values: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    i, j, k = (np.clip(xyz[:, axis], 0, values.shape[2 - axis] - 1) for axis in range(3))
    return values[k, j, i]
