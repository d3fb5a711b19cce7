# mypy: ignore-errors
"""Warp kernels that draw solid bodies into grids: arithmetic only, twins are the bodies' NumPy distances.

Each launch covers the part of a grid that holds one body; its first dim counts planes from `first`.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

CAPSULE = wp.constant(0)
CYLINDER = wp.constant(1)
BOX = wp.constant(2)
FIELD = wp.constant(3)


@wp.struct
class Solid:
    """A body in units of the voxels of the grid that it is drawn into.

    to_body, shift: body position = to_body @ (array index) + shift. kind: one of CAPSULE, CYLINDER, BOX, FIELD.
    half: radius, unused, half length; or half edges; or the half edges of the field's box.
    spacing: between samples of the field, whose values count in it.
    """

    kind: int
    half: wp.vec3
    spacing: float
    to_body: wp.mat33
    shift: wp.vec3


@wp.func
def sampled(field: wp.array3d[wp.float32], at: wp.vec3):
    """Trilinear; `at` (x, y, z) counts samples and lies within the grid."""
    i = wp.min(int(at[0]), field.shape[2] - 2)
    j = wp.min(int(at[1]), field.shape[1] - 2)
    k = wp.min(int(at[2]), field.shape[0] - 2)
    tx = at[0] - float(i)
    ty = at[1] - float(j)
    tz = at[2] - float(k)
    near = wp.lerp(
        wp.lerp(field[k, j, i], field[k, j, i + 1], tx), wp.lerp(field[k, j + 1, i], field[k, j + 1, i + 1], tx), ty
    )
    far = wp.lerp(
        wp.lerp(field[k + 1, j, i], field[k + 1, j, i + 1], tx),
        wp.lerp(field[k + 1, j + 1, i], field[k + 1, j + 1, i + 1], tx),
        ty,
    )
    return wp.lerp(near, far, tz)


@wp.func
def distance(solid: Solid, field: wp.array3d[wp.float32], index: wp.vec3):
    """Signed distance [voxels], negative inside."""
    p = solid.to_body * index + solid.shift
    if solid.kind == FIELD:
        within = wp.max(wp.min(p, solid.half), -solid.half)
        away = wp.length(p - within)
        if away > 1.0:  # the field is positive at its rim, so this voxel is empty and need not be exact
            return away
        return sampled(field, (within + solid.half) / solid.spacing) * solid.spacing + away
    if solid.kind == BOX:
        d = wp.vec3(wp.abs(p[0]), wp.abs(p[1]), wp.abs(p[2])) - solid.half
        return wp.length(wp.max(d, wp.vec3(0.0))) + wp.min(wp.max(d), 0.0)
    radial = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    along = wp.abs(p[2]) - solid.half[2]
    if solid.kind == CYLINDER:
        radial = radial - solid.half[0]
        outside = wp.vec2(wp.max(radial, 0.0), wp.max(along, 0.0))
        return wp.length(outside) + wp.min(wp.max(radial, along), 0.0)
    return wp.length(wp.vec2(radial, wp.max(along, 0.0))) - solid.half[0]


@wp.kernel
def draw_solid(
    plane: int,
    first: wp.vec3i,
    body: Solid,
    field: wp.array3d[wp.float32],
    centre: wp.vec3,
    velocity: wp.vec3,
    spin: wp.vec3,
    solid: wp.array3d[wp.int32],
    wall_velocity: wp.array3d[wp.vec3],
):
    """Cells whose centre lies inside become solid and move with velocity + spin x (cell - centre) [cells/step]."""
    k, j, i = wp.tid()
    x = i + first[0]
    y = j + first[1]
    z = k + plane + first[2]
    index = wp.vec3(float(x), float(y), float(z))
    if distance(body, field, index) < 0.0:
        solid[z, y, x] = 1
        wall_velocity[z, y, x] = velocity + wp.cross(spin, index - centre)


@wp.kernel
def draw_fraction(
    plane: int, first: wp.vec3i, body: Solid, field: wp.array3d[wp.float32], fraction: wp.array3d[wp.float32]
):
    """Solid part of each voxel: a ramp one voxel wide across the surface, joined with what is drawn already."""
    k, j, i = wp.tid()
    x = i + first[0]
    y = j + first[1]
    z = k + plane + first[2]
    part = 0.5 - distance(body, field, wp.vec3(float(x), float(y), float(z)))
    fraction[z, y, x] = wp.max(fraction[z, y, x], wp.clamp(part, 0.0, 1.0))


@wp.kernel
def clear_solid(plane: int, first: wp.vec3i, solid: wp.array3d[wp.int32], wall_velocity: wp.array3d[wp.vec3]):
    k, j, i = wp.tid()
    solid[k + plane + first[2], j + first[1], i + first[0]] = 0
    wall_velocity[k + plane + first[2], j + first[1], i + first[0]] = wp.vec3(0.0)


@wp.kernel
def clear_fraction(plane: int, first: wp.vec3i, fraction: wp.array3d[wp.float32]):
    k, j, i = wp.tid()
    fraction[k + plane + first[2], j + first[1], i + first[0]] = 0.0


@wp.kernel
def mesh_distance(
    plane: int,
    mesh: wp.uint64,
    origin: wp.vec3,
    spacing: float,
    reach: float,
    distances: wp.array3d[wp.float32],
):
    """Distance to a mesh at every sample, negative where its winding number exceeds 1/2."""
    k, j, i = wp.tid()
    z = k + plane
    point = origin + spacing * wp.vec3(float(i), float(j), float(z))
    query = wp.mesh_query_point_sign_winding_number(mesh, point, reach)
    nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
    distances[z, j, i] = query.sign * wp.length(nearest - point)
