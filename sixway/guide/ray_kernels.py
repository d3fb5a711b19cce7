"""What every march shares: rays, samples along them, and eight exponentials at once. `oracle.py` says the same.

A CPU works on eight floats at a time only where the compiler is told so, hence the native snippets.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

LANES = wp.constant(8)

Lanes = wp.types.vector(length=8, dtype=wp.float32)
"""Eight values: of eight steps along a ray, or of the six lights in the order of `DIRECTIONS` and two to spare."""


@wp.struct
class View:
    """A camera. Positions in metres from the grid's corner; right, up: half the image's size at the target [m].

    to_target_m: from the camera to its target.
    """

    position_m: wp.vec3
    to_target_m: wp.vec3
    right_m: wp.vec3
    up_m: wp.vec3
    perspective: int
    height_px: int
    width_px: int


@wp.func
def image_point(view: View, row: int, column: int, ray: int, rays_a_side: int) -> wp.vec2:
    """Where a ray of a pixel's square of rays leaves, from -1 to 1 to the right and upwards."""
    x = float(column) + (float(ray % rays_a_side) + 0.5) / float(rays_a_side)
    y = float(row) + (float(ray / rays_a_side) + 0.5) / float(rays_a_side)
    return wp.vec2(x / float(view.width_px) * 2.0 - 1.0, 1.0 - y / float(view.height_px) * 2.0)


@wp.func
def camera_ray(view: View, point: wp.vec2):
    """Origin [m] and unit vector away from the camera through a point of the image."""
    across = point[0] * view.right_m + point[1] * view.up_m
    origin = view.position_m
    forward = view.to_target_m
    if view.perspective == 1:
        forward += across
    else:
        origin += across
    return origin, wp.normalize(forward)


@wp.func
def uniform_hash(seed: wp.uint32, index: wp.uint32) -> float:
    """A number in [0, 1) from two integers: PCG-RXS-M-XS (Jarzynski and Olano 2020, `pcg`)."""
    state = (index + seed * wp.uint32(2654435769)) * wp.uint32(747796405) + wp.uint32(2891336453)
    word = ((state >> ((state >> wp.uint32(28)) + wp.uint32(4))) ^ state) * wp.uint32(277803737)
    word = (word >> wp.uint32(22)) ^ word
    return float(word >> wp.uint32(8)) * (1.0 / 16777216.0)


@wp.func
def slab(origin: wp.vec3, forward: wp.vec3, extent: wp.vec3) -> wp.vec2:
    """Distances at which a ray enters and leaves the box [0, extent]; enters > leaves on a miss."""
    t_near = float(0.0)
    t_far = float(1.0e30)
    for axis in range(3):
        if wp.abs(forward[axis]) < 1.0e-8:
            if origin[axis] < 0.0 or origin[axis] > extent[axis]:
                t_far = float(-1.0)
        else:
            a = -origin[axis] / forward[axis]
            b = (extent[axis] - origin[axis]) / forward[axis]
            t_near = wp.max(t_near, wp.min(a, b))
            t_far = wp.min(t_far, wp.max(a, b))
    return wp.vec2(t_near, t_far)


@wp.func
def henyey_greenstein(cosine: float, g: float) -> float:
    """Phase function [1/sr] for the angle between incoming and outgoing travel."""
    base = 1.0 + g * g - 2.0 * g * cosine
    return (1.0 - g * g) / (4.0 * wp.pi * base * wp.sqrt(base))


_TRILINEAR_ALONG = """
    const float* values = field.data;
    const int nx = field.shape[2], ny = field.shape[1], nz = field.shape[0];
    wp::vec_t<8, float> sampled;
    #pragma clang loop vectorize(assume_safety)
    for (int lane = 0; lane < 8; ++lane) {
        float x = voxel.c[0] + lane * step.c[0] - 0.5f;
        float y = voxel.c[1] + lane * step.c[1] - 0.5f;
        float z = voxel.c[2] + lane * step.c[2] - 0.5f;
        // far outside all weights are 0: held near, so that whole numbers do not overflow
        x = x < -2.0f ? -2.0f : (x > nx + 1.0f ? nx + 1.0f : x);
        y = y < -2.0f ? -2.0f : (y > ny + 1.0f ? ny + 1.0f : y);
        z = z < -2.0f ? -2.0f : (z > nz + 1.0f ? nz + 1.0f : z);
        float fx = floorf(x), fy = floorf(y), fz = floorf(z);
        int i = (int)fx, j = (int)fy, k = (int)fz;
        float tx = x - fx, ty = y - fy, tz = z - fz;
        float x0 = (i >= 0 && i < nx) ? 1.0f - tx : 0.0f, x1 = (i >= -1 && i < nx - 1) ? tx : 0.0f;
        float y0 = (j >= 0 && j < ny) ? 1.0f - ty : 0.0f, y1 = (j >= -1 && j < ny - 1) ? ty : 0.0f;
        float z0 = (k >= 0 && k < nz) ? 1.0f - tz : 0.0f, z1 = (k >= -1 && k < nz - 1) ? tz : 0.0f;
        int i0 = i < 0 ? 0 : (i < nx ? i : nx - 1), i1 = i < -1 ? 0 : (i + 1 < nx ? i + 1 : nx - 1);
        int j0 = j < 0 ? 0 : (j < ny ? j : ny - 1), j1 = j < -1 ? 0 : (j + 1 < ny ? j + 1 : ny - 1);
        int k0 = k < 0 ? 0 : (k < nz ? k : nz - 1), k1 = k < -1 ? 0 : (k + 1 < nz ? k + 1 : nz - 1);
        int row00 = (k0 * ny + j0) * nx, row01 = (k0 * ny + j1) * nx;
        int row10 = (k1 * ny + j0) * nx, row11 = (k1 * ny + j1) * nx;
        float near = y0 * (x0 * values[row00 + i0] + x1 * values[row00 + i1]);
        near += y1 * (x0 * values[row01 + i0] + x1 * values[row01 + i1]);
        float far = y0 * (x0 * values[row10 + i0] + x1 * values[row10 + i1]);
        far += y1 * (x0 * values[row11 + i0] + x1 * values[row11 + i1]);
        sampled.c[lane] = z0 * near + z1 * far;
    }
    return sampled;
"""


@wp.func_native(_TRILINEAR_ALONG)
def trilinear_along(field: wp.array3d(dtype=float), voxel: wp.vec3, step: wp.vec3) -> Lanes:
    """The field at eight positions voxel + n step in voxel units (voxel 0 is centred at 0.5); 0 outside the grid."""
    ...


_EXP_MINUS = """
    wp::vec_t<8, float> passed;
    #pragma clang loop vectorize(assume_safety)
    for (int lane = 0; lane < 8; ++lane) {
        float power = depths.c[lane] * -1.44269504f;  // of two
        power = power < -126.0f ? -126.0f : power;
        float whole = floorf(power + 0.5f);
        float part = power - whole;
        // 2^part to 4e-9 on [-1/2, 1/2], exactly 1 at 0: least squares on Chebyshev nodes
        float two = 0.00015329347f;
        two = 0.0013390296f + part * two;
        two = 0.0096184678f + part * two;
        two = 0.055503585f + part * two;
        two = 0.24022648f + part * two;
        two = 0.69314719f + part * two;
        two = 1.0f + part * two;
        union { int bits; float value; } scale;
        scale.bits = ((int)whole + 127) << 23;
        passed.c[lane] = two * scale.value;
    }
    return passed;
"""


@wp.func_native(_EXP_MINUS)
def exp_minus(depths: Lanes) -> Lanes:
    """exp(-x) of eight optical depths >= 0, to float32's last two bits; no less than 2^-126."""
    ...
