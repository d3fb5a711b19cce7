"""Warp kernels of the flow that seldom run: placing inlets and obstacles, velocity of the ghost cells.

Arrays are [z, y, x] with a shell of one ghost cell. `first`: the first row (`sixway.bands`).
"""

import warp as wp

from sixway.sim.flow import lattice

wp.set_module_options({"enable_backward": False})

FLUID = wp.constant(lattice.FLUID)
SOLID = wp.constant(lattice.SOLID)
OPEN = wp.constant(lattice.OPEN)
INLET = wp.constant(lattice.INLET)
IMAGE = wp.constant(lattice.IMAGE)


@wp.func
def inner(i: int, n: int):
    """The nearest index within the box; n with the shell."""
    return wp.clamp(i, 1, n - 2)


@wp.func
def repeated(i: int, n: int):
    """The index on the other side of the box, of an index of the shell."""
    return wp.where(i == 0, n - 2, wp.where(i == n - 1, 1, i))


@wp.func
def image_axis(i: int, n: int, what: int, axis: int):
    """One index of `image_of`."""
    if (what & (1 << axis)) != 0:
        return inner(i, n)
    if (what & (16 << axis)) != 0:
        return repeated(i, n)
    return i


@wp.func
def image_of(k: int, j: int, i: int, kind: wp.array3d[wp.int32]):
    """(k, j, i) of the cell that a cell stands for: itself but for IMAGE ones."""
    what = kind[k, j, i]
    if (what & IMAGE) == 0:
        return wp.vec3i(k, j, i)
    return wp.vec3i(
        image_axis(k, kind.shape[0], what, 2),
        image_axis(j, kind.shape[1], what, 1),
        image_axis(i, kind.shape[2], what, 0),
    )


@wp.func
def mirrored(component: float, mirror: int):
    """A velocity's component, reflected if mirror is not 0."""
    return wp.where(mirror != 0, -component, component)


@wp.func
def in_box(k: int, j: int, i: int, kind: wp.array3d[wp.int32]):
    """Whether a cell is not of the shell."""
    inside = k > 0 and k < kind.shape[0] - 1 and j > 0 and j < kind.shape[1] - 1
    return inside and i > 0 and i < kind.shape[2] - 1


@wp.kernel
def place_inlets(
    first: int,
    inlet: wp.array3d[wp.int32],
    kind: wp.array3d[wp.int32],
    kind_without_solid: wp.array3d[wp.int32],
):
    """Make chosen cells INLET, now and where an obstacle lets go of them; not the repetitions of others."""
    k, j, i = wp.tid()
    k += first
    wrapped = kind[k, j, i] >= 16
    if inlet[k, j, i] != 0 and not wrapped:
        kind_without_solid[k, j, i] = INLET
        kind[k, j, i] = INLET


@wp.kernel
def place_solid(
    first: int,
    solid: wp.array3d[wp.int32],
    wall_velocity: wp.array3d[wp.vec3],
    kind_without_solid: wp.array3d[wp.int32],
    kind: wp.array3d[wp.int32],
    imposed: wp.array3d[wp.vec3],
    uncovered: wp.array3d[wp.int32],
):
    """New kinds within the box; `uncovered`: 1 where air comes out of an obstacle."""
    k, j, i = wp.tid()
    k += first
    if not in_box(k, j, i, kind):
        return
    was_solid = kind[k, j, i] == SOLID
    uncovered[k, j, i] = 0
    if solid[k, j, i] != 0:
        kind[k, j, i] = SOLID
        imposed[k, j, i] = wall_velocity[k, j, i]
    else:
        kind[k, j, i] = kind_without_solid[k, j, i]
        if was_solid and kind_without_solid[k, j, i] == FLUID:
            uncovered[k, j, i] = 1


@wp.kernel
def density_around(
    first: int,
    kind: wp.array3d[wp.int32],
    uncovered: wp.array3d[wp.int32],
    density: wp.array3d[wp.float32],
    refilled: wp.array3d[wp.float32],
):
    """Mean density of the air around an uncovered cell, 1 if there is none."""
    k, j, i = wp.tid()
    k += first
    if uncovered[k, j, i] == 0:
        return
    total = float(0.0)
    count = float(0.0)
    for c in range(-1, 2):
        for b in range(-1, 2):
            for a in range(-1, 2):
                if kind[k + c, j + b, i + a] == FLUID and uncovered[k + c, j + b, i + a] == 0:
                    total += density[k + c, j + b, i + a]
                    count += 1.0
    refilled[k, j, i] = wp.where(count > 0.0, total / wp.max(count, 1.0), 1.0)


@wp.kernel
def extend(
    first: int,
    kind: wp.array3d[wp.int32],
    imposed: wp.array3d[wp.vec3],
    density: wp.array3d[wp.float32],
    velocity: wp.array3d[wp.vec3],
):
    """Density and velocity of the shell: of the cell it stands for, or before it; a wall has its own velocity.

    One thread a row: of most rows only the ends belong to the shell.
    """
    k, j = wp.tid()
    k += first
    nx = kind.shape[2]
    through_box = k > 0 and k < kind.shape[0] - 1 and j > 0 and j < kind.shape[1] - 1
    stride = wp.where(through_box, nx - 1, 1)
    for i in range(0, nx, stride):
        at = image_of(k, j, i, kind)
        there = kind[at[0], at[1], at[2]]
        z = inner(at[0], kind.shape[0])
        y = inner(at[1], kind.shape[1])
        x = inner(at[2], nx)
        u = velocity[z, y, x]
        if there == SOLID or there == INLET:
            u = imposed[at[0], at[1], at[2]]
        if (kind[k, j, i] & IMAGE) != 0:
            flip = kind[k, j, i]
            u = wp.vec3(mirrored(u[0], flip & 1), mirrored(u[1], flip & 2), mirrored(u[2], flip & 4))
        density[k, j, i] = density[z, y, x]
        velocity[k, j, i] = u
