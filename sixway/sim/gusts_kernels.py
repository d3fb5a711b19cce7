"""The Warp kernel that imposes inlets and winds; its twin is `Gusts.at`."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def blow(
    cell: wp.array[wp.vec3i],
    source: wp.array[wp.int32],
    mean: wp.array[wp.vec3],
    wave: wp.array2d[wp.vec3],
    amplitude: wp.array2d[wp.vec3],
    frequency: wp.array2d[wp.float32],
    phase: wp.array2d[wp.float32],
    time: float,
    imposed: wp.array3d[wp.vec3],
):
    """Impose each INLET cell's mean velocity plus its source's gusts, cells/step; `cell` counts the shell."""
    n = wp.tid()
    m = source[n]
    c = cell[n]
    x = wp.vec3(float(c[0]), float(c[1]), float(c[2]))
    u = mean[n]
    for a in range(wave.shape[1]):
        u += amplitude[m, a] * wp.cos(wp.dot(wave[m, a], x) + frequency[m, a] * time + phase[m, a])
    imposed[c[2], c[1], c[0]] = u
