"""NumPy float64 twins of the kernels in `advection`, `forces` and `burn`: slow, whole-array, from the equations.

Layouts and units are theirs: fields [f, z, y, x], velocity [z, y, x, 3] with its shell, positions (x, y, z) in voxels.
`faces` are the six kinds of `sixway.sim.carried.advection_kernels`, x_low first.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from sixway.sim.carried.advection_kernels import CLOSED, OPEN, PERIODIC

Velocity = Float[np.ndarray, "vz vy vx 3"]
Fields = Float[np.ndarray, "f z y x"]
Points = Float[np.ndarray, "n 3"]
Solid = Bool[np.ndarray, "z y x"]
SHUT = (CLOSED,) * 6


def advect(
    velocity: Velocity,
    fields: Fields,
    *,
    refinement: int,
    steps: float,
    scheme: str,
    faces: tuple[int, ...] = SHUT,
    solid_before: Solid | None = None,
    solid: Solid | None = None,
    floor: float = 0.0,
) -> Fields:
    """One step of "cubic" or "linear" over all voxels, without skipping any."""
    shape = fields.shape[1:]
    nowhere = np.zeros(shape, bool)
    before = nowhere if solid_before is None else solid_before
    now = nowhere if solid is None else solid
    at = voxel_positions(shape)
    d = displacement(velocity, at, refinement=refinement, steps=steps, faces=faces)
    stopped = last_free(before, at, d, faces)
    base = np.floor(stopped).astype(int)
    part = stopped - base
    base += at.astype(int)
    outside = came_from_outside(at + stopped, shape, faces)
    walled = touches_solid(before, base, 1, faces)
    carried = []
    for field in fields:
        value = free_linear(field, before, base, part, faces)
        if scheme == "cubic":
            value = np.where(walled, value, clamped_cubic(field, base, part, faces))
        carried.append(_floored(np.where(outside | now.reshape(-1), 0.0, value), floor))
    return np.reshape(carried, fields.shape)


def voxel_positions(shape: tuple[int, ...]) -> Points:
    """(x, y, z) of all voxels in the order of memory."""
    z, y, x = np.indices(shape).reshape(3, -1)
    return np.stack([x, y, z], axis=1).astype(np.float64)


def displacement(
    velocity: Velocity, at: Points, *, refinement: int, steps: float, faces: tuple[int, ...] = SHUT
) -> Points:
    """From voxels to where their air was `steps` ago [voxels], midpoint rule."""
    x = (at + 0.5) / refinement + 0.5
    middle = x - 0.5 * steps * wind(velocity, x)
    for axis in range(3):
        if faces[2 * axis] == PERIODIC:
            middle[:, axis] = (middle[:, axis] - 0.5) % (velocity.shape[2 - axis] - 2) + 0.5
    return -refinement * steps * wind(velocity, middle)


def wind(velocity: Velocity, at: Points) -> Points:
    """Trilinear velocity at positions in cells of the array; beyond it the nearest cell's."""
    most = np.array(velocity.shape[2::-1]) - 1
    at = np.clip(at, 0, most)
    base = np.minimum(np.floor(at).astype(int), most - 1)
    part = at - base
    total = np.zeros_like(at)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, part, 1.0 - part), axis=1)
        i, j, k = (base + corner).T
        total += weight[:, None] * velocity[k, j, i]
    return total


def came_from_outside(at: Points, shape: tuple[int, ...], faces: tuple[int, ...]) -> Bool[np.ndarray, "n"]:
    outside = np.zeros(len(at), bool)
    for axis in range(3):
        outside |= (faces[2 * axis] == OPEN) & (at[:, axis] < -0.5)
        outside |= (faces[2 * axis + 1] == OPEN) & (at[:, axis] >= shape[2 - axis] - 0.5)
    return outside


def last_free(solid: Solid, at: Points, d: Points, faces: tuple[int, ...]) -> Points:
    """The part of each displacement before it meets a wall, in half-voxel steps."""
    kept = np.zeros_like(d)
    free = ~_read(solid, at.astype(int), faces)
    stopped = np.zeros(len(at), bool)
    count = np.ceil(2.0 * np.abs(d).max(axis=1)).astype(int)
    for step in range(1, int(count.max(initial=0)) + 1):
        q = d * (step / np.maximum(count, 1))[:, None]
        hit = _read(solid, at.astype(int) + np.floor(q + 0.5).astype(int), faces)
        active = (step <= count) & ~stopped
        stopped |= active & hit & free
        moved = active & ~hit
        kept[moved] = q[moved]
        free |= moved
    return kept


def touches_solid(
    solid: Solid, base: Int[np.ndarray, "n 3"], margin: int, faces: tuple[int, ...]
) -> Bool[np.ndarray, "n"]:
    """Whether the eight voxels from `base` up, and `margin` more all around, hold a solid one."""
    touched = np.zeros(len(base), bool)
    for offset in np.ndindex((2 + 2 * margin,) * 3):
        touched |= _read(solid, base + np.array(offset) - margin, faces)
    return touched


def free_linear(
    field: Float[np.ndarray, "z y x"], solid: Solid, base: Int[np.ndarray, "n 3"], part: Points, faces: tuple[int, ...]
) -> Float[np.ndarray, "n"]:
    """Trilinear among the voxels that are free; 0 where none is."""
    total, weights = np.zeros(len(base)), np.zeros(len(base))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, part, 1.0 - part), axis=1)
        weight = weight * ~_read(solid, base + corner, faces)
        total += weight * _read(field, base + corner, faces)
        weights += weight
    return np.divide(total, weights, out=np.zeros(len(base)), where=weights > 0.0)


def clamped_cubic(
    field: Float[np.ndarray, "z y x"], base: Int[np.ndarray, "n 3"], part: Points, faces: tuple[int, ...]
) -> Float[np.ndarray, "n"]:
    """Catmull-Rom in each axis, clamped to the eight voxels around."""
    powers = np.stack([np.ones_like(part), part, part**2, part**3], axis=-1)
    basis = 0.5 * np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]])
    weights = powers @ basis
    total = np.zeros(len(base))
    for offset in np.ndindex(4, 4, 4):
        weight = np.prod([weights[:, axis, step] for axis, step in enumerate(offset)], axis=0)
        total += weight * _read(field, base + np.array(offset) - 1, faces)
    around = np.stack([_read(field, base + corner, faces) for corner in np.ndindex(2, 2, 2)])
    return np.clip(total, around.min(axis=0), around.max(axis=0))


def cool(
    temperature: np.ndarray, *, rate_per_s: float, radiation_k_per_s: float, hottest_k: float, seconds: float
) -> np.ndarray:
    """dT/dt = -rate T, then dT/dt = -radiation (T / hottest)^4, by a thousand small steps each."""
    hot = np.array(temperature, dtype=np.float64)
    for _ in range(1000):
        hot -= seconds / 1000 * rate_per_s * hot
    for _ in range(1000):
        middle = hot - 0.5 * seconds / 1000 * radiation_k_per_s * (np.maximum(hot, 0.0) / hottest_k) ** 4
        hot -= seconds / 1000 * radiation_k_per_s * (np.maximum(middle, 0.0) / hottest_k) ** 4
    return hot


def push(
    velocity: Velocity, fields: Fields, *, confinement: float, lifts: tuple[float, ...], refinement: int
) -> Float[np.ndarray, "3 cz cy cx"]:
    """Acceleration inside the shell: Fedkiw et al. 2001, Eqs. 9 to 11, plus the lift of each field's cell means."""
    ddz, ddy, ddx = (
        (np.roll(velocity, -1, axis=axis) - np.roll(velocity, 1, axis=axis))[1:-1, 1:-1, 1:-1] / 2 for axis in range(3)
    )
    omega = np.stack([ddy[..., 2] - ddz[..., 1], ddz[..., 0] - ddx[..., 2], ddx[..., 1] - ddy[..., 0]], axis=-1)
    swirl = np.pad(np.linalg.norm(omega, axis=-1), 1, mode="edge")
    uphill = np.stack(
        [(np.roll(swirl, -1, axis=axis) - np.roll(swirl, 1, axis=axis))[1:-1, 1:-1, 1:-1] / 2 for axis in (2, 1, 0)],
        axis=-1,
    )
    steepness = np.linalg.norm(uphill, axis=-1, keepdims=True)
    n = np.divide(uphill, steepness, out=np.zeros_like(uphill), where=steepness > 1e-12)
    force = np.moveaxis(confinement * np.cross(n, omega), -1, 0)
    force[1] += np.tensordot(np.array(lifts), cell_means(fields, refinement), axes=1)
    return force


def cell_means(fields: Float[np.ndarray, "*f z y x"], refinement: int) -> Float[np.ndarray, "*f cz cy cx"]:
    z, y, x = (n // refinement for n in fields.shape[-3:])
    blocks = fields.reshape(*fields.shape[:-3], z, refinement, y, refinement, x, refinement)
    return blocks.mean(axis=(-5, -3, -1))


def burn(
    density: np.ndarray,
    temperature: np.ndarray,
    fuel: np.ndarray,
    flame: np.ndarray,
    *,
    ignition: float,
    rate: float,
    heat: float,
    hottest: float,
    soot: float,
    expansion: float,
    most_growth: float,
    flame_life: float,
    seconds: float,
    steps: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The four fields after `seconds`, and each voxel's growth a lattice step."""
    burns = (fuel > 0.0) & (temperature >= ignition)
    burnt = np.where(burns, fuel * (1.0 - np.exp(-rate * seconds)), 0.0)
    growth = np.minimum(expansion * burnt / steps, most_growth)
    thinner = np.exp(-growth * steps)
    aged = np.maximum(flame - seconds / flame_life, 0.0)
    return (
        (density + soot * burnt) * thinner,
        np.where(burns, np.maximum(temperature, np.minimum(temperature + heat * burnt, hottest)), temperature),
        (fuel - burnt) * thinner,
        np.where(burns, np.maximum(aged, np.minimum(fuel, 1.0)), aged),
        growth,
    )


def _read(values: np.ndarray, xyz: Int[np.ndarray, "n 3"], faces: tuple[int, ...]) -> np.ndarray:
    """Voxels at indices (x, y, z); beyond a face the nearest, or the one a period away."""
    folded = []
    for axis in range(3):
        n = values.shape[2 - axis]
        index = xyz[:, axis]
        folded.append(index % n if faces[2 * axis] == PERIODIC else np.clip(index, 0, n - 1))
    i, j, k = folded
    return values[k, j, i]


def _floored(values: np.ndarray, floor: float) -> np.ndarray:
    return np.where(np.abs(values) <= floor, 0.0, values)
