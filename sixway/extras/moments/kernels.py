# mypy: ignore-errors
"""Warp kernels of the moment-encoded lattice: ghost cells and others that are no fluid, and what is read from it.

`cells`: [10, place], planes in the order of `generated.MOMENTS`. `first`: the first row.
"""

import warp as wp

from sixway.sim.flow.kernels import FLUID, IMAGE, OPEN, SOLID, image_of, inner

wp.set_module_options({"enable_backward": False})


@wp.func
def number(k: int, j: int, i: int, kind: wp.array3d[wp.int32]):
    """A cell's place in its plane."""
    return (k * kind.shape[1] + j) * kind.shape[2] + i


@wp.func
def sign(mirror: bool):
    return wp.where(mirror, -1.0, 1.0)


@wp.func
def write(n: int, shift: float, v: wp.vec3, cells: wp.array2d[wp.float32]):
    """Density 1 + shift, velocity v, no stress."""
    cells[0, n] = shift
    for a in range(3):
        cells[1 + a, n] = v[a]
    for p in range(4, 10):
        cells[p, n] = 0.0


@wp.kernel
def find_walls(first: int, kind: wp.array3d[wp.int32], walls: wp.array3d[wp.int32]):
    """walls: 1 where a cell is SOLID or the image of one."""
    k, j, i = wp.tid()
    k += first
    at = image_of(k, j, i, kind)
    walls[k, j, i] = wp.where(kind[at[0], at[1], at[2]] == SOLID, 1, 0)


@wp.func
def air_around(at: wp.vec3i, kind: wp.array3d[wp.int32], cells: wp.array2d[wp.float32]):
    """Mean density - 1 of the air among the six neighbours of a cell, which receives what an INLET cell sends."""
    total = float(0.0)
    count = float(0.0)
    for axis in range(3):
        for side in range(2):
            b = wp.vec3i(at[0], at[1], at[2])
            b[axis] = b[axis] + 2 * side - 1
            if b[axis] >= 0 and b[axis] < kind.shape[axis]:
                if kind[b[0], b[1], b[2]] == FLUID:
                    total += cells[0, number(b[0], b[1], b[2], kind)]
                    count += 1.0
    return total / wp.max(count, 1.0)


@wp.kernel
def stand_for(
    first: int,
    kind: wp.array3d[wp.int32],
    imposed: wp.array3d[wp.vec3],
    drawn: float,
    cells: wp.array2d[wp.float32],
):
    """Moments of what is no air, from air alone, as `flow.generated.edges.send` says; walls have their velocity.

    drawn: share of an OPEN side's density that is drawn towards 1.
    """
    k, j, i = wp.tid()
    k += first
    here = kind[k, j, i]
    if here == FLUID:
        return
    n = number(k, j, i, kind)
    at = image_of(k, j, i, kind)
    flip = wp.where((here & IMAGE) != 0, here & 7, 0)
    sx = sign((flip & 1) != 0)
    sy = sign((flip & 2) != 0)
    sz = sign((flip & 4) != 0)
    what = kind[at[0], at[1], at[2]]
    z = inner(at[0], kind.shape[0])  # the cell itself, or the one before an OPEN side
    y = inner(at[1], kind.shape[1])
    x = inner(at[2], kind.shape[2])
    m = number(z, y, x, kind)
    v = wp.vec3(cells[1, m], cells[2, m], cells[3, m])
    if what == OPEN:
        inwards = float(x - at[2]) * v[0] > 0.0 or float(y - at[1]) * v[1] > 0.0 or float(z - at[0]) * v[2] > 0.0
        if inwards or kind[z, y, x] != FLUID:
            write(n, 0.0, wp.vec3(0.0, 0.0, 0.0), cells)
        else:
            write(n, (1.0 - drawn) * cells[0, m], wp.vec3(sx * v[0], sy * v[1], sz * v[2]), cells)
        return
    if what != FLUID:
        u = imposed[at[0], at[1], at[2]]
        write(n, air_around(at, kind, cells), wp.vec3(sx * u[0], sy * u[1], sz * u[2]), cells)
        return
    write(n, cells[0, m], wp.vec3(sx * v[0], sy * v[1], sz * v[2]), cells)
    for p in range(4, 7):
        cells[p, n] = cells[p, m]
    cells[7, n] = sx * sy * cells[7, m]
    cells[8, n] = sx * sz * cells[8, m]
    cells[9, n] = sy * sz * cells[9, m]


@wp.kernel
def fill(
    first: int,
    chosen: wp.array3d[wp.int32],
    density: wp.array3d[wp.float32],
    velocity: wp.array3d[wp.vec3],
    cells: wp.array2d[wp.float32],
):
    """Equilibrium of a density and a velocity in chosen cells of the box."""
    k, j, i = wp.tid()
    k += first
    if chosen[k + 1, j + 1, i + 1] != 0:
        n = number(k + 1, j + 1, i + 1, chosen)
        write(n, density[k + 1, j + 1, i + 1] - 1.0, velocity[k + 1, j + 1, i + 1], cells)


@wp.kernel
def measure(
    first: int,
    kind: wp.array3d[wp.int32],
    imposed: wp.array3d[wp.vec3],
    force: wp.array4d[wp.float32],
    cells: wp.array2d[wp.float32],
    density: wp.array3d[wp.float32],
    velocity: wp.array3d[wp.vec3],
):
    """Density and velocity in the middle of the last step: its end has the whole force, of which this has half."""
    k, j, i = wp.tid()
    k += first
    if kind[k, j, i] != FLUID:
        density[k, j, i] = 1.0
        velocity[k, j, i] = imposed[k, j, i]
        return
    n = number(k, j, i, kind)
    a = wp.vec3(force[0, k, j, i], force[1, k, j, i], force[2, k, j, i])
    density[k, j, i] = 1.0 + cells[0, n]
    velocity[k, j, i] = wp.vec3(cells[1, n], cells[2, n], cells[3, n]) - 0.5 * a
