# mypy: ignore-errors
"""Warp kernels of `sixway.sim.carried.forces`: arithmetic only, twins in `sixway.sim.carried.oracle`."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def curl(first: int, velocity: wp.array3d[wp.vec3], vorticity: wp.array3d[wp.vec3]):
    """Central differences [1/step] of the cells inside the shell."""
    row, j, i = wp.tid()
    k = first + row
    dx = 0.5 * (velocity[k + 1, j + 1, i + 2] - velocity[k + 1, j + 1, i])
    dy = 0.5 * (velocity[k + 1, j + 2, i + 1] - velocity[k + 1, j, i + 1])
    dz = 0.5 * (velocity[k + 2, j + 1, i + 1] - velocity[k, j + 1, i + 1])
    vorticity[k, j, i] = wp.vec3(dy[2] - dz[1], dz[0] - dx[2], dx[1] - dy[0])


@wp.func
def swirl(vorticity: wp.array3d[wp.vec3], i: int, j: int, k: int):
    """|vorticity|, beyond a face that of the nearest cell."""
    x = wp.clamp(i, 0, vorticity.shape[2] - 1)
    y = wp.clamp(j, 0, vorticity.shape[1] - 1)
    z = wp.clamp(k, 0, vorticity.shape[0] - 1)
    return wp.length(vorticity[z, y, x])


@wp.kernel
def push(
    first: int,
    confinement: float,
    vorticity: wp.array3d[wp.vec3],
    lifts: wp.array[wp.float32],
    refinement: int,
    fields: wp.array4d[wp.float32],
    force: wp.array4d[wp.float32],
):
    """Confinement plus the mean of each field over the cell times its lift."""
    row, j, i = wp.tid()
    k = first + row
    a = wp.vec3(0.0, 0.0, 0.0)
    if confinement > 0.0:
        uphill = 0.5 * wp.vec3(
            swirl(vorticity, i + 1, j, k) - swirl(vorticity, i - 1, j, k),
            swirl(vorticity, i, j + 1, k) - swirl(vorticity, i, j - 1, k),
            swirl(vorticity, i, j, k + 1) - swirl(vorticity, i, j, k - 1),
        )
        steepness = wp.length(uphill)
        if steepness > 1.0e-12:  # still air has no direction of growing swirl
            a = confinement * wp.cross(uphill / steepness, vorticity[k, j, i])
    for f in range(fields.shape[0]):
        if lifts[f] != 0.0:
            total = float(0.0)
            for c in range(refinement):
                for b in range(refinement):
                    for d in range(refinement):
                        total += fields[f, k * refinement + c, j * refinement + b, i * refinement + d]
            a[1] += lifts[f] * total / float(refinement * refinement * refinement)
    force[0, k + 1, j + 1, i + 1] = a[0]
    force[1, k + 1, j + 1, i + 1] = a[1]
    force[2, k + 1, j + 1, i + 1] = a[2]
