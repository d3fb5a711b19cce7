"""NumPy float64 twin of a whole step of `sixway.sim.flow.flow`: whole-array, slow, written from the equations.

Arrays are [z, y, x] with a shell of one cell, populations [q, z, y, x] as g = f - w: what each cell sends along c_q.
"""

import numpy as np
from jaxtyping import Float, Int

from sixway.sim.flow import collision_oracle
from sixway.sim.flow.lattice import FLUID, IMAGE, INLET, OPEN, SOLID, CollisionModel, Lattice

PRESSURE_DRAWN = 0.01
"""Part of its difference from 1 that the density beyond an OPEN side loses against the cell before it."""

Populations = Float[np.ndarray, "q z y x"]
Kind = Int[np.ndarray, "z y x"]
Velocity = Float[np.ndarray, "z y x 3"]
Density = Float[np.ndarray, "z y x"]


def step(
    lattice: Lattice,
    model: CollisionModel,
    kind: Kind,
    imposed: Velocity,
    force: Float[np.ndarray, "3 z y x"],
    g: Populations,
    *,
    tau: float,
    smagorinsky: float,
) -> Populations:
    """What the air sends after one more step; what is no air sends 0 until it is asked to (`send`)."""
    pulled = stream(lattice, send(lattice, kind, imposed, g))
    with np.errstate(all="ignore"):  # what is no air collides too, and is thrown away
        collided, _, _ = collision_oracle.collide(lattice, model, pulled, force, tau=tau, smagorinsky=smagorinsky)
    return np.where(kind == FLUID, collided, 0.0)


def grow(lattice: Lattice, kind: Kind, growth: Float[np.ndarray, "z y x"], g: Populations) -> Populations:
    """g with gas of the air's own velocity added: w_q s (1 + 3 c_q . u) in FLUID cells."""
    density, momentum = moments(lattice, g)
    u = momentum / np.where(kind == FLUID, density, 1.0)[..., None]
    part = 1.0 + 3.0 * np.einsum("qa,zyxa->qzyx", lattice.velocities.astype(np.float64), u)
    return g + np.where(kind == FLUID, lattice.weights[:, None, None, None] * growth * part, 0.0)


def stream(lattice: Lattice, g: Populations) -> Populations:
    """Each cell takes what its upwind neighbours send."""
    return np.stack([np.roll(g[q], (z, y, x), axis=(0, 1, 2)) for q, (x, y, z) in enumerate(lattice.velocities)])


def send(lattice: Lattice, kind: Kind, imposed: Velocity, g: Populations) -> Populations:
    """g with what SOLID, INLET, OPEN and IMAGE cells send (`generated.edges.send` says what)."""
    at, mirrored = images(kind)
    what, wall = kind[at], np.where(mirrored, -1.0, 1.0) * imposed[at]
    shift, outwards = leaving(lattice, kind, g)
    outside = equilibrium(lattice, shift[at], np.where(mirrored, -1.0, 1.0) * outwards[at])
    density = moments(lattice, g)[0]
    sent = g.copy()
    for q, (x, y, z) in enumerate(lattice.velocities):
        struck = np.roll(g[lattice.opposite[q]], (-z, -y, -x), axis=(0, 1, 2))
        struck_density = np.roll(density, (-z, -y, -x), axis=(0, 1, 2))
        bounced = struck + 6.0 * lattice.weights[q] * struck_density * (wall @ lattice.velocities[q])
        blown = equilibrium(lattice, struck_density - 1.0, wall)[q]
        by_flip = np.stack([g[lattice.mirrored([bool(flip >> a & 1) for a in range(3)])[q]] for flip in range(8)])
        copied = by_flip[(mirrored @ np.array([1, 2, 4]), *at)]
        choices = [copied, bounced, outside[q], blown]
        sent[q] = np.select([what == FLUID, what == SOLID, what == OPEN, what == INLET], choices)
    return sent


def leaving(lattice: Lattice, kind: Kind, g: Populations) -> tuple[Density, Velocity]:
    """Density - 1 and velocity beyond an OPEN side: the inner cell's if that blows outwards, else of air at rest."""
    inner = tuple(np.clip(index, 1, n - 2) for index, n in zip(np.indices(kind.shape), kind.shape, strict=True))
    density, momentum = moments(lattice, g)
    air = kind == FLUID
    u = np.where(air[..., None], momentum / density[..., None], 0.0)[inner]
    shift = (1.0 - PRESSURE_DRAWN) * np.where(air, density - 1.0, 0.0)[inner]
    inwards = np.zeros(kind.shape, dtype=bool)
    for axis, (index, n) in enumerate(zip(np.indices(kind.shape), kind.shape, strict=True)):
        component = u[..., 2 - axis]
        inwards |= (index == 0) & (component > 0.0) | (index == n - 1) & (component < 0.0)
    return np.where(inwards, 0.0, shift), np.where(inwards[..., None], 0.0, u)


def images(kind: Kind) -> tuple[tuple[np.ndarray, ...], Int[np.ndarray, "z y x 3"]]:
    """Indices of the cell that each cell stands for, itself but for IMAGE ones; and whether mirrored in x, y, z."""
    at, mirrored = [], np.zeros((*kind.shape, 3), dtype=int)
    for axis, (index, n) in enumerate(zip(np.indices(kind.shape), kind.shape, strict=True)):
        is_image, xyz = (kind & IMAGE) != 0, 2 - axis
        mirror, repeat = (is_image & (kind >> shift & 1 == 1) for shift in (xyz, 4 + xyz))
        mirrored[..., xyz] = mirror
        across = np.where(index == 0, n - 2, np.where(index == n - 1, 1, index))
        at.append(np.where(mirror, np.clip(index, 1, n - 2), np.where(repeat, across, index)))
    return tuple(at), mirrored


def moments(lattice: Lattice, g: Populations) -> tuple[Density, Velocity]:
    """Density and momentum."""
    return 1.0 + g.sum(axis=0), np.einsum("qa,qzyx->zyxa", lattice.velocities.astype(np.float64), g)


def equilibrium(lattice: Lattice, shift: Density, u: Velocity) -> Populations:
    """f_eq - w of density 1 + shift: the Maxwellian to second order in u (Krueger et al. 2017, Eq. 3.4)."""
    cu = np.einsum("qa,zyxa->qzyx", lattice.velocities, u)
    bracket = 3.0 * cu + 4.5 * cu**2 - 1.5 * np.sum(u**2, axis=-1)
    return lattice.weights[:, None, None, None] * (shift + (1.0 + shift) * bracket)


def measure(
    lattice: Lattice, kind: Kind, imposed: Velocity, force: Float[np.ndarray, "3 z y x"], g: Populations
) -> tuple[Density, Velocity]:
    """Density and velocity in the middle of the last step, within the box; 1 and what is imposed where no air is."""
    density, momentum = moments(lattice, g)
    air = kind == FLUID
    velocity = momentum / np.where(air, density, 1.0)[..., None] - 0.5 * np.moveaxis(force, 0, -1)
    return np.where(air, density, 1.0), np.where(air[..., None], velocity, imposed)


def force_on_solid(lattice: Lattice, kind: Kind, imposed: Velocity, g: Populations) -> Float[np.ndarray, "3"]:
    """Momentum that SOLID cells of the box take in the coming step, also across its sides (Wen et al. 2014, Eq. 12)."""
    sent = send(lattice, kind, imposed, g)
    at, mirrored = images(kind)
    turn = np.where(mirrored, -1.0, 1.0)
    inside = np.zeros(kind.shape, dtype=bool)
    inside[1:-1, 1:-1, 1:-1] = True
    body = (kind[at] == SOLID) & inside[at]
    total = np.zeros(3)
    for q, c in enumerate(lattice.velocities.astype(np.float64)):
        x, y, z = lattice.velocities[q]
        struck = np.roll(g[lattice.opposite[q]], (-z, -y, -x), axis=(0, 1, 2))[..., None]
        links = body & np.roll((kind == FLUID) & inside, (-z, -y, -x), axis=(0, 1, 2))
        wall = turn * imposed[at]
        given = (-c - wall) * struck - (c - wall) * sent[q][..., None]
        total += (turn * given)[links].sum(axis=0)
    return total
