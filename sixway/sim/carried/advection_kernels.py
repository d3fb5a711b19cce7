# mypy: ignore-errors
"""Warp kernels that carry scalars along the wind: arithmetic only, twins in `sixway.sim.carried.oracle`.

Scalars are [field, z, y, x], one backtrace serves them all; the velocity [z, y, x] has a shell of one cell and may be
coarser. No kernel scatters. Kernels take the number of their first row first (`sixway.bands`).

`clear_cubic` is native, for a compiler makes vectors of its rows of four and none of Warp's code: a third of the time
on a CPU. It is plain C++, so CUDA compiles it as well.
"""

import warp as wp

from sixway.sim.carried.survey_kernels import BLOCK, SOLID_BIT

wp.set_module_options({"enable_backward": False})

LINEAR, CUBIC = 0, 1
CLOSED, OPEN, PERIODIC = 0, 1, 2
"""Kinds of faces: smoke stays inside; clear air enters; the opposite face follows."""
LONGEST_TRACE = 4096
"""Samples of a backtrace at most: a velocity that blew up must not hang the machine."""

vec6i = wp.types.vector(length=6, dtype=wp.int32)


@wp.func_native("""
// rows of four voxels along x: min and max of the inner four rows first, for they may settle the matter
const int row = field.shape[3], layer = row * field.shape[2];
const float* p = field.data + ((long long)f * field.shape[1] + k - 1) * layer + (j - 1) * row + i - 1;
float low[4], high[4];
for (int a = 0; a < 4; ++a) low[a] = high[a] = p[layer + row + a];
for (int c = 1; c < 3; ++c) for (int b = 1; b < 3; ++b) for (int a = 0; a < 4; ++a) {
    const float value = p[c * layer + b * row + a];
    low[a] = value < low[a] ? value : low[a];
    high[a] = value > high[a] ? value : high[a];
}
const float least = low[1] < low[2] ? low[1] : low[2];
const float most = high[1] > high[2] ? high[1] : high[2];
if (least == most) return least;

float w[3][4];
const float part[3] = {fx, fy, fz};
for (int axis = 0; axis < 3; ++axis) {
    const float t = part[axis];
    w[axis][0] = 0.5f * t * (t * (2.0f - t) - 1.0f);
    w[axis][1] = 0.5f * (t * t * (3.0f * t - 5.0f) + 2.0f);
    w[axis][2] = 0.5f * t * (t * (4.0f - 3.0f * t) + 1.0f);
    w[axis][3] = 0.5f * t * t * (t - 1.0f);
}
float sum[4] = {0.0f, 0.0f, 0.0f, 0.0f};
for (int c = 0; c < 4; ++c) for (int b = 0; b < 4; ++b) {
    const float weight = w[2][c] * w[1][b];
    for (int a = 0; a < 4; ++a) sum[a] += weight * p[c * layer + b * row + a];
}
const float value = w[0][0] * sum[0] + w[0][1] * sum[1] + w[0][2] * sum[2] + w[0][3] * sum[3];
return value < least ? least : (value > most ? most : value);
""")
def clear_cubic(
    field: wp.array4d[wp.float32], f: int, i: int, j: int, k: int, fx: float, fy: float, fz: float
) -> float: ...


@wp.func
def between(a: wp.vec3, b: wp.vec3, t: float):
    """a + t (b - a): exact where a = b, which `wp.lerp` is not."""
    return a + t * (b - a)


@wp.func
def wind(velocity: wp.array3d[wp.vec3], x: float, y: float, z: float):
    """Velocity [cells/step] at a position in cells of the array, shell included; beyond it the nearest."""
    i = wp.clamp(int(x), 0, velocity.shape[2] - 2)  # also where x is NaN: an index must not leave the array
    j = wp.clamp(int(y), 0, velocity.shape[1] - 2)
    k = wp.clamp(int(z), 0, velocity.shape[0] - 2)
    fx = wp.clamp(x - float(i), 0.0, 1.0)
    fy = wp.clamp(y - float(j), 0.0, 1.0)
    fz = wp.clamp(z - float(k), 0.0, 1.0)
    low = between(
        between(velocity[k, j, i], velocity[k, j, i + 1], fx),
        between(velocity[k, j + 1, i], velocity[k, j + 1, i + 1], fx),
        fy,
    )
    high = between(
        between(velocity[k + 1, j, i], velocity[k + 1, j, i + 1], fx),
        between(velocity[k + 1, j + 1, i], velocity[k + 1, j + 1, i + 1], fx),
        fy,
    )
    return between(low, high, fz)


@wp.func
def wrap(x: float, n: int, face: int):
    """Position in the array, brought back into the n cells of a periodic axis."""
    if face == PERIODIC and x < 0.5:
        return x + float(n)
    if face == PERIODIC and x >= float(n) + 0.5:
        return x - float(n)
    return x


@wp.func
def displacement(velocity: wp.array3d[wp.vec3], i: int, j: int, k: int, refinement: float, steps: float, faces: vec6i):
    """From a voxel to where its air was `steps` lattice steps ago [voxels]: midpoint rule (RK2).

    An offset, not a position: it is small, so float32 keeps its digits, and an even wind moves all voxels alike.
    """
    x = (float(i) + 0.5) / refinement + 0.5
    y = (float(j) + 0.5) / refinement + 0.5
    z = (float(k) + 0.5) / refinement + 0.5
    u = wind(velocity, x, y, z)
    half = 0.5 * steps
    x = wrap(x - half * u[0], velocity.shape[2] - 2, faces[0])
    y = wrap(y - half * u[1], velocity.shape[1] - 2, faces[2])
    z = wrap(z - half * u[2], velocity.shape[0] - 2, faces[4])
    u = wind(velocity, x, y, z)
    return (-refinement * steps) * u


@wp.func
def fold(i: int, n: int, face: int):
    """Index of the voxel that stands for i: the nearest one, or the one a period away."""
    if face == PERIODIC:
        return ((i % n) + n) % n
    return wp.clamp(i, 0, n - 1)


@wp.func
def came_from_outside(i: int, d: float, n: int, low: int, high: int):
    """Whether the air has entered through an OPEN face of this axis."""
    x = float(i) + d
    return (low == OPEN and x < -0.5) or (high == OPEN and x >= float(n) - 0.5)


@wp.func
def is_solid(solid: wp.array3d[wp.uint8], i: int, j: int, k: int, faces: vec6i):
    x = fold(i, solid.shape[2], faces[0])
    y = fold(j, solid.shape[1], faces[2])
    z = fold(k, solid.shape[0], faces[4])
    return int(solid[z, y, x]) != 0


@wp.func
def last_free(solid: wp.array3d[wp.uint8], i: int, j: int, k: int, d: wp.vec3, faces: vec6i):
    """The part of displacement d before it meets a wall, in half-voxel steps: smoke does not come through walls.

    A voxel that an obstacle has just left starts inside the old obstacle and may leave it once.
    """
    count = wp.clamp(int(wp.ceil(2.0 * wp.max(wp.abs(d)))), 0, LONGEST_TRACE)
    kept = wp.vec3(0.0, 0.0, 0.0)
    free = not is_solid(solid, i, j, k, faces)
    for step in range(1, count + 1):
        q = d * (float(step) / float(count))
        x = i + int(wp.floor(q[0] + 0.5))
        y = j + int(wp.floor(q[1] + 0.5))
        z = k + int(wp.floor(q[2] + 0.5))
        if not is_solid(solid, x, y, z, faces):
            free = True
            kept = q
        elif free:
            return kept
    return kept


@wp.func
def touches_solid(solid: wp.array3d[wp.uint8], i: int, j: int, k: int, margin: int, faces: vec6i):
    """Whether a stencil has a solid voxel: the eight voxels from (i, j, k) up, and `margin` more all around."""
    for c in range(-margin, 2 + margin):
        for b in range(-margin, 2 + margin):
            for a in range(-margin, 2 + margin):
                if is_solid(solid, i + a, j + b, k + c, faces):
                    return True
    return False


@wp.func
def is_inner(i: int, n: int):
    """Whether the four voxels around i + 1/2 lie in the box."""
    return i >= 1 and i <= n - 3


@wp.func
def voxel(field: wp.array4d[wp.float32], f: int, i: int, j: int, k: int, faces: vec6i):
    x = fold(i, field.shape[3], faces[0])
    y = fold(j, field.shape[2], faces[2])
    z = fold(k, field.shape[1], faces[4])
    return field[f, z, y, x]


@wp.func
def free_linear(
    field: wp.array4d[wp.float32],
    solid: wp.array3d[wp.uint8],
    walled: bool,
    f: int,
    i: int,
    j: int,
    k: int,
    t: wp.vec3,
    faces: vec6i,
):
    """Trilinear value at (i, j, k) + t of the voxels that are free, 0 where none is; within their bounds."""
    total = float(0.0)
    weights = float(0.0)
    least = float(0.0)
    most = float(0.0)
    for c in range(2):
        for b in range(2):
            for a in range(2):
                wx = wp.where(a == 1, t[0], 1.0 - t[0])
                wy = wp.where(b == 1, t[1], 1.0 - t[1])
                wz = wp.where(c == 1, t[2], 1.0 - t[2])
                weight = wx * wy * wz
                if not (walled and is_solid(solid, i + a, j + b, k + c, faces)) and weight > 0.0:
                    value = voxel(field, f, i + a, j + b, k + c, faces)
                    least = wp.where(weights > 0.0, wp.min(least, value), value)
                    most = wp.where(weights > 0.0, wp.max(most, value), value)
                    total += weight * value
                    weights += weight
    if weights > 0.0:
        return wp.clamp(total / weights, least, most)
    return float(0.0)


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
def edge_cubic(field: wp.array4d[wp.float32], f: int, i: int, j: int, k: int, t: wp.vec3, faces: vec6i):
    """`clear_cubic` where the stencil leaves the box."""
    wx = catmull_rom(t[0])
    wy = catmull_rom(t[1])
    wz = catmull_rom(t[2])
    least = voxel(field, f, i, j, k, faces)
    most = least
    total = float(0.0)
    for c in range(4):
        for b in range(4):
            row = float(0.0)
            for a in range(4):
                value = voxel(field, f, i + a - 1, j + b - 1, k + c - 1, faces)
                row += wx[a] * value
                if (a == 1 or a == 2) and (b == 1 or b == 2) and (c == 1 or c == 2):
                    least = wp.min(least, value)
                    most = wp.max(most, value)
            total += wz[c] * wy[b] * row
    return wp.clamp(total, least, most)


@wp.kernel
def advect(
    first: int,
    span: int,
    velocity: wp.array3d[wp.vec3],
    solid_before: wp.array3d[wp.uint8],
    solid: wp.array3d[wp.uint8],
    flags: wp.array3d[wp.int32],
    refinement: float,
    steps: float,
    faces: vec6i,
    scheme: int,
    floor: float,
    before: wp.array4d[wp.float32],
    after: wp.array4d[wp.float32],
):
    """Semi-Lagrangian step of all fields (Stam 1999), trilinear or clamped tricubic; a thread does `span` voxels of x.

    solid_before: obstacles when `before` was made, they block the backtrace; solid: obstacles now, they hold no smoke.
    Values up to `floor` become 0. flags: see `sixway.sim.carried.survey_kernels`.
    """
    row, j, column = wp.tid()
    k = first + row
    for i in range(column * span, wp.min((column + 1) * span, before.shape[3])):
        bits = flags[k // BLOCK, j // BLOCK, i // BLOCK]
        walled = (bits & SOLID_BIT) != 0
        if (bits & ~SOLID_BIT) == 0 or (walled and int(solid[k, j, i]) != 0):
            for f in range(before.shape[0]):
                after[f, k, j, i] = 0.0
        else:
            d = displacement(velocity, i, j, k, refinement, steps, faces)
            if walled:
                d = last_free(solid_before, i, j, k, d, faces)
            base = wp.vec3(wp.floor(d[0]), wp.floor(d[1]), wp.floor(d[2]))
            t = d - base
            x = i + int(base[0])
            y = j + int(base[1])
            z = k + int(base[2])
            clear = (
                came_from_outside(i, d[0], before.shape[3], faces[0], faces[1])
                or came_from_outside(j, d[1], before.shape[2], faces[2], faces[3])
                or came_from_outside(k, d[2], before.shape[1], faces[4], faces[5])
            )
            inner = is_inner(x, before.shape[3]) and is_inner(y, before.shape[2]) and is_inner(z, before.shape[1])
            cubic = scheme == CUBIC and not (walled and touches_solid(solid_before, x, y, z, 1, faces))
            for f in range(before.shape[0]):
                value = float(0.0)
                if not clear and (bits & (1 << f)) != 0:
                    if cubic and inner:
                        value = clear_cubic(before, f, x, y, z, t[0], t[1], t[2])
                    elif cubic:
                        value = edge_cubic(before, f, x, y, z, t, faces)
                    else:
                        value = free_linear(before, solid_before, walled, f, x, y, z, t, faces)
                    if wp.abs(value) <= floor:  # false for NaN, which must stay in sight
                        value = 0.0
                after[f, k, j, i] = value
