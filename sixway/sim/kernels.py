"""Warp kernels of the smoke simulation: arithmetic only, twins in `sixway.sim.oracle`.

Arrays are [z, y, x], populations [q, z, y, x]; vectors (x, y, z). Populations are stored shifted by
their weights, g_q = f_q - w_q, which keeps float32's digits for what differs from air at rest
(Krueger et al. 2017, Sec. 4.3.1). No kernel scatters, so the order of threads cannot matter.
"""

import warp as wp

from sixway.sim import lattice

wp.set_module_options({"enable_backward": False, "max_unroll": 19})

vec19 = wp.types.vector(length=19, dtype=wp.float32)
vec19i = wp.types.vector(length=19, dtype=wp.int32)
mat19x3i = wp.types.matrix(shape=(19, 3), dtype=wp.int32)

C = wp.constant(mat19x3i(lattice.VELOCITIES.astype("int32").flatten().tolist()))
W = wp.constant(vec19(lattice.WEIGHTS.tolist()))
OPPOSITE = wp.constant(vec19i(lattice.OPPOSITE.tolist()))
FLUID = wp.constant(lattice.FLUID)
SOLID = wp.constant(lattice.SOLID)
OPEN = wp.constant(lattice.OPEN)
INLET = wp.constant(lattice.INLET)


@wp.func
def upwind(i: int, n: int):
    """Periodic indices i + 1, i, i - 1: where populations moving by -1, 0, 1 come from."""
    return wp.vec3i(wp.where(i + 1 < n, i + 1, 0), i, wp.where(i > 0, i - 1, n - 1))


@wp.func
def along(q: int, v: wp.vec3):
    """c_q . v"""
    return float(C[q, 0]) * v[0] + float(C[q, 1]) * v[1] + float(C[q, 2]) * v[2]


@wp.func
def equilibrium(q: int, density_shift: float, u: wp.vec3):
    """f_q^eq - w_q of density 1 + density_shift (Krueger et al. 2017, Eq. 3.4)."""
    cu = along(q, u)
    return W[q] * (density_shift + (1.0 + density_shift) * (3.0 * cu + 4.5 * cu * cu - 1.5 * wp.dot(u, u)))


@wp.func
def eddy_relaxation_time(tau: float, stress: float, density: float, smagorinsky: float):
    """tau with Smagorinsky's eddy viscosity, closed form (Hou et al. 1996). stress: |Pi^neq|, Frobenius."""
    return 0.5 * (tau + wp.sqrt(tau * tau + 25.455844 * smagorinsky * smagorinsky * stress / density))


@wp.kernel
def collide_and_stream(
    kind: wp.array3d[wp.int32],
    lift: wp.array3d[wp.float32],
    tau: float,
    smagorinsky: float,
    before: wp.array4d[wp.float32],
    after: wp.array4d[wp.float32],
    velocity: wp.array3d[wp.vec3],
):
    """One step of BGK: pull the post-collision populations `before`, collide, write `after` and `velocity`.

    lift: upward acceleration [cells/step^2]. The velocity of INLET cells is read, that of FLUID cells
    is written; SOLID and OPEN cells are left alone.
    """
    k, j, i = wp.tid()
    here = kind[k, j, i]
    if here == INLET:
        for q in range(19):
            after[q, k, j, i] = equilibrium(q, 0.0, velocity[k, j, i])
    if here != FLUID:
        return

    # air may leave through an OPEN cell above with its speed, but comes in from rest: with the speed
    # of the last step a backflow would feed on itself
    leaving = wp.vec3(0.0, wp.max(velocity[k, j, i][1], 0.0), 0.0)
    xs = upwind(i, kind.shape[2])
    ys = upwind(j, kind.shape[1])
    zs = upwind(k, kind.shape[0])
    g = vec19()
    for q in range(19):  # unrolled; wp.static lets the compiler see the indices (a quarter faster on CPU)
        x = xs[wp.static(int(lattice.VELOCITIES[q, 0]) + 1)]
        y = ys[wp.static(int(lattice.VELOCITIES[q, 1]) + 1)]
        z = zs[wp.static(int(lattice.VELOCITIES[q, 2]) + 1)]
        there = kind[z, y, x]
        if there == SOLID:
            g[q] = before[wp.static(int(lattice.OPPOSITE[q])), k, j, i]
        elif there == OPEN:
            g[q] = equilibrium(q, 0.0, leaving)
        else:
            g[q] = before[q, z, y, x]

    shift = float(0.0)
    momentum = wp.vec3(0.0, 0.0, 0.0)
    for q in range(19):
        shift += g[q]
        momentum += g[q] * wp.vec3(float(C[q, 0]), float(C[q, 1]), float(C[q, 2]))
    density = 1.0 + shift
    force = wp.vec3(0.0, lift[k, j, i] * density, 0.0)
    u = (momentum + 0.5 * force) / density

    xx = float(0.0)
    yy = float(0.0)
    zz = float(0.0)
    xy = float(0.0)
    xz = float(0.0)
    yz = float(0.0)
    neq = vec19()
    for q in range(19):
        neq[q] = g[q] - equilibrium(q, shift, u)
        xx += float(C[q, 0] * C[q, 0]) * neq[q]
        yy += float(C[q, 1] * C[q, 1]) * neq[q]
        zz += float(C[q, 2] * C[q, 2]) * neq[q]
        xy += float(C[q, 0] * C[q, 1]) * neq[q]
        xz += float(C[q, 0] * C[q, 2]) * neq[q]
        yz += float(C[q, 1] * C[q, 2]) * neq[q]
    stress = wp.sqrt(xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz))
    omega = 1.0 / eddy_relaxation_time(tau, stress, density, smagorinsky)

    for q in range(19):
        # Guo, Zheng & Shi 2002, Eq. 20: the force enters to second order
        push = 3.0 * (along(q, force) - wp.dot(u, force)) + 9.0 * along(q, u) * along(q, force)
        after[q, k, j, i] = g[q] - omega * neq[q] + (1.0 - 0.5 * omega) * W[q] * push
    velocity[k, j, i] = u


@wp.kernel
def blow(
    cell: wp.array[wp.vec3i],
    inlet: wp.array[wp.int32],
    mean: wp.array[wp.vec3],
    wave: wp.array2d[wp.vec3],
    amplitude: wp.array2d[wp.vec3],
    frequency: wp.array2d[wp.float32],
    phase: wp.array2d[wp.float32],
    time: float,
    velocity: wp.array3d[wp.vec3],
):
    """Impose each INLET cell's mean velocity plus its inlet's gusts (`sixway.sim.inlets.Gusts`)."""
    n = wp.tid()
    m = inlet[n]
    c = cell[n]
    x = wp.vec3(float(c[0]), float(c[1]), float(c[2]))
    u = mean[n]
    for a in range(wave.shape[1]):
        u += amplitude[m, a] * wp.cos(wp.dot(wave[m, a], x) + frequency[m, a] * time + phase[m, a])
    velocity[c[2], c[1], c[0]] = u


@wp.func
def velocity_at(velocity: wp.array3d[wp.vec3], p: wp.vec3, refinement: float):
    """Trilinear velocity [cells/step] at voxel position p; the velocity grid has a shell of one cell."""
    x = wp.clamp((p[0] + 0.5) / refinement + 0.5, 0.0, float(velocity.shape[2]) - 1.001)
    y = wp.clamp((p[1] + 0.5) / refinement + 0.5, 0.0, float(velocity.shape[1]) - 1.001)
    z = wp.clamp((p[2] + 0.5) / refinement + 0.5, 0.0, float(velocity.shape[0]) - 1.001)
    i = wp.clamp(int(x), 0, velocity.shape[2] - 2)  # NaN passes the clamp above; it must not leave the array
    j = wp.clamp(int(y), 0, velocity.shape[1] - 2)
    k = wp.clamp(int(z), 0, velocity.shape[0] - 2)
    fx = x - float(i)
    fy = y - float(j)
    fz = z - float(k)
    low = wp.lerp(
        wp.lerp(velocity[k, j, i], velocity[k, j, i + 1], fx),
        wp.lerp(velocity[k, j + 1, i], velocity[k, j + 1, i + 1], fx),
        fy,
    )
    high = wp.lerp(
        wp.lerp(velocity[k + 1, j, i], velocity[k + 1, j, i + 1], fx),
        wp.lerp(velocity[k + 1, j + 1, i], velocity[k + 1, j + 1, i + 1], fx),
        fy,
    )
    return wp.lerp(low, high, fz)


@wp.func
def departure(velocity: wp.array3d[wp.vec3], p: wp.vec3, refinement: float, steps: float):
    """Where the air at voxel p was `steps` lattice steps ago: midpoint rule (RK2), in voxels."""
    reach = refinement * steps
    middle = p - 0.5 * reach * velocity_at(velocity, p, refinement)
    return p - reach * velocity_at(velocity, middle, refinement)


@wp.func
def voxel(smoke: wp.array3d[wp.float32], i: int, j: int, k: int):
    """Density of a voxel; beyond a face the nearest one."""
    x = wp.clamp(i, 0, smoke.shape[2] - 1)
    y = wp.clamp(j, 0, smoke.shape[1] - 1)
    z = wp.clamp(k, 0, smoke.shape[0] - 1)
    return smoke[z, y, x]


@wp.func
def catmull_rom(t: float):
    """Weights of the voxels -1, 0, 1, 2 around t in [0, 1] (Catmull & Rom 1974)."""
    return wp.vec4(
        0.5 * t * (t * (2.0 - t) - 1.0),
        0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
        0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
        0.5 * t * t * (t - 1.0),
    )


@wp.func
def sample(smoke: wp.array3d[wp.float32], p: wp.vec3, cubic: bool):
    """Density at voxel position p: trilinear, or tricubic clamped to the eight voxels around p."""
    i = int(wp.floor(p[0]))
    j = int(wp.floor(p[1]))
    k = int(wp.floor(p[2]))
    f = p - wp.vec3(float(i), float(j), float(k))
    v000 = voxel(smoke, i, j, k)
    v100 = voxel(smoke, i + 1, j, k)
    v010 = voxel(smoke, i, j + 1, k)
    v110 = voxel(smoke, i + 1, j + 1, k)
    v001 = voxel(smoke, i, j, k + 1)
    v101 = voxel(smoke, i + 1, j, k + 1)
    v011 = voxel(smoke, i, j + 1, k + 1)
    v111 = voxel(smoke, i + 1, j + 1, k + 1)
    low = wp.lerp(wp.lerp(v000, v100, f[0]), wp.lerp(v010, v110, f[0]), f[1])
    high = wp.lerp(wp.lerp(v001, v101, f[0]), wp.lerp(v011, v111, f[0]), f[1])
    linear = wp.lerp(low, high, f[2])
    least = wp.min(wp.min(wp.min(v000, v100), wp.min(v010, v110)), wp.min(wp.min(v001, v101), wp.min(v011, v111)))
    most = wp.max(wp.max(wp.max(v000, v100), wp.max(v010, v110)), wp.max(wp.max(v001, v101), wp.max(v011, v111)))
    if not cubic or least == most:  # the clamp would undo the cubic: skip 64 loads in clear air
        return wp.clamp(linear, least, most)

    wx = catmull_rom(f[0])
    wy = catmull_rom(f[1])
    wz = catmull_rom(f[2])
    total = float(0.0)
    for c in range(4):
        for b in range(4):
            row = float(0.0)
            for a in range(4):
                row += wx[a] * voxel(smoke, i + a - 1, j + b - 1, k + c - 1)
            total += wz[c] * wy[b] * row
    return wp.clamp(total, least, most)


@wp.kernel
def advect(
    velocity: wp.array3d[wp.vec3],
    source: wp.array3d[wp.float32],
    obstacle: wp.array3d[wp.float32],
    refinement: float,
    steps: float,
    cubic: bool,
    before: wp.array3d[wp.float32],
    after: wp.array3d[wp.float32],
):
    """Carry density along the wind (semi-Lagrangian, Stam 1999), feed the inlets, empty the obstacles.

    What comes in through the open top is clear air, so smoke that has left does not return.
    """
    k, j, i = wp.tid()
    if obstacle[k, j, i] >= 0.5:
        after[k, j, i] = 0.0
        return
    p = departure(velocity, wp.vec3(float(i), float(j), float(k)), refinement, steps)
    carried = float(0.0)
    if p[1] < float(before.shape[1]) - 0.5:
        carried = sample(before, p, cubic)
    after[k, j, i] = wp.max(carried, source[k, j, i])


@wp.kernel
def buoyancy(smoke: wp.array3d[wp.float32], refinement: int, strength: float, lift: wp.array3d[wp.float32]):
    """Upward acceleration of a velocity cell: `strength` [cells/step^2] times its mean density (Boussinesq)."""
    k, j, i = wp.tid()
    total = float(0.0)
    for c in range(refinement):
        for b in range(refinement):
            for a in range(refinement):
                total += smoke[k * refinement + c, j * refinement + b, i * refinement + a]
    lift[k + 1, j + 1, i + 1] = strength * total / float(refinement * refinement * refinement)
