"""The arithmetic of the cached reference, traced by Dr.Jit: rays, phase function, march, directions.

Every number that may differ between calls arrives as an opaque array of width 1, never as a Python
number: Dr.Jit bakes those into the kernel and would compile a new one for every seed or camera.
"""

from collections.abc import Callable

import drjit as dr
import mitsuba as mi

_R2 = (0.7548776662466927, 0.5698402909980532)  # 1/p and 1/p^2, p^3 = p + 1 (Roberts 2018, the R2 sequence)
_GOLDEN = 0.6180339887498949

_CUTOFF = 1e-3  # of transmittance, where gathered rays end: below the noise of their directions

Six = list  # six mi.Float, in the order of DIRECTIONS
Source = Callable[[list, Six], Six]


class Box:
    """The grid in the world: lowest corner and extents [m], voxel size [m].

    A plain class: Dr.Jit would carry the fields of a dataclass through every loop as state.
    """

    def __init__(self, *, origin, extent, voxel) -> None:
        self.origin, self.extent, self.voxel = origin, extent, voxel

    def span(self, origin, direction):
        """Distances [m] at which rays enter (>= 0) and leave the box; leave <= enter where they miss."""
        inverse = 1.0 / dr.select(dr.abs(direction) < 1e-12, 1e-12, direction)
        near = (self.origin - origin) * inverse
        far = (self.origin + self.extent - origin) * inverse
        return dr.maximum(dr.max(dr.minimum(near, far)), 0.0), dr.min(dr.maximum(near, far))

    def to_texture(self, point):
        return (point - self.origin) / self.extent


def grid_texture(tensor):
    """A trilinear texture of [z, y, x, channels] over the box [0, 1]^3."""
    return mi.Texture3f(tensor, use_accel=False)  # hardware would interpolate with 8-bit weights


def henyey_greenstein(cosine, g):
    """Phase function [1/sr]; cosine between the directions of PROPAGATION before and after."""
    denominator = 1.0 + g * g - 2.0 * g * cosine
    return dr.inv_four_pi * (1.0 - g * g) / (denominator * dr.sqrt(denominator))


def phases(discs: list[list], ray, g) -> Six:
    """Phase function [1/sr] of the six lights towards the origin of a ray that looks along `ray`.

    discs: unit vectors towards the points of each light, over which it is averaged.

    Light travels along -to_light and leaves along -ray: both signs cancel.
    """
    return [sum(henyey_greenstein(dr.dot(sun, ray), g) for sun in suns) / len(suns) for suns in discs]


def sunlight(fields, phase: Six) -> Six:
    """In-scattered radiance [1/sr per unit irradiance] of the six lights, from their optical depths."""
    return [p * dr.exp(-tau) for p, tau in zip(phase, fields[1:7], strict=True)]


def scattered_light(fields, phase: Six) -> Six:
    """In-scattered radiance that a grid of scattered light already holds."""
    return fields[1:7]


@dr.syntax
def swept(volume, box: Box, first, step, count):
    """Optical depth at `count` points in a row from `first`, `step` apart, by the trapezoid rule.

    One row per lane; [count, lanes], the depth before the first point being left out.
    """
    lane = dr.arange(mi.UInt32, dr.width(first))
    lanes = dr.opaque(mi.UInt32, dr.width(first))
    depths = dr.empty(mi.Float, dr.width(first) * count[0])
    length = dr.norm(step)
    depth = mi.Float(0)
    before = mi.Float(0)
    index = mi.UInt32(0)
    while index < count:
        sigma_t = volume.eval(box.to_texture(first + mi.Float(index) * step))[0]
        depth += 0.5 * length * (before + sigma_t)
        dr.scatter(depths, depth, index * lanes + lane)
        before = sigma_t
        index += 1
    return depths


@dr.syntax
def march(sample: Callable, source: Source, box: Box, origin, ray, phase: Six, *, offset, step, albedo, cutoff):
    """Radiance of the six lights against each ray, and the ray's transmittance.

    L_k = sum_n albedo T_n sigma_t(x_n) h source_k(x_n),  T_n = T_{n-1} exp(-h (sigma_t(x_{n-1}) + sigma_t(x_n)) / 2)

    A sum over points with transmittance AT each point is right in the mean over `offset`, however thick a voxel
    is; slabs of constant brightness are not, because their front hides their back.

    sample(world point, ray) -> fields, fields[0] = sigma_t [1/m], and whether the ray ends there.
    offset: where in its step, [0, 1), each ray looks. step: h [m]. The point where the transmittance falls
    below `cutoff` stands for all that is behind: to end there without it would lose light at every bounce.
    """
    near, far = box.span(origin, ray)
    distance = near + offset * step
    length = offset * step
    before, _ = sample(origin + near * ray, ray)
    sigma_t = before[0]
    transmittance = mi.Float(1)
    radiance = [mi.Float(0) for _ in range(6)]
    active = distance < far
    while active:
        fields, blocked = sample(origin + distance * ray, ray)
        passed = transmittance * dr.exp(-0.5 * length * (sigma_t + fields[0]))
        transmittance = dr.select(blocked, transmittance, passed)
        sigma_t = fields[0]
        thickness = sigma_t * step
        opaque = passed < cutoff
        weight = dr.select(blocked, 0.0, passed * albedo * dr.select(opaque, 1.0 + 0.5 * thickness, thickness))
        radiance = add_weighted(radiance, weight, source(fields, phase))
        transmittance = dr.select(opaque, 0.0, transmittance)
        length = mi.Float(step)
        distance += step
        active = (distance < far) & (transmittance > 0.0) & ~blocked
    return radiance, transmittance


@dr.syntax
def gathered(sample, source: Source, box: Box, start, outgoing, discs, *, step, rotation, samples, g, albedo):
    """In-scattered radiance at each point: the mean over `samples` directions of what arrives there.

    Directions follow the phase function around `outgoing` (unit vectors, the way the light leaves), so
    that the mean needs no weight; `rotation` (three floats in [0, 1)) turns the R2 sequence of each point and
    the golden ratio's, which says where in its step a ray looks.
    """
    index = mi.UInt32(0)
    total = [mi.Float(0) for _ in range(6)]
    frame = mi.Frame3f(outgoing)
    while index < samples:
        u, v, offset = stratified(index, rotation)
        ray = -frame.to_world(sample_henyey_greenstein(u, v, g))
        phase = phases(discs, ray, g)
        arriving, _ = march(
            sample, source, box, start, ray, phase, offset=offset, step=step, albedo=albedo, cutoff=_CUTOFF
        )
        total = add_weighted(total, mi.Float(1), arriving)
        index += 1
    return [value / mi.Float(samples) for value in total]


@dr.syntax
def gathered_moments(sample, source: Source, box: Box, start, to_lights, discs, *, step, rotation, samples, g, albedo):
    """In-scattered radiance by direction, S(w) = c_0 + c w + a_2 P_2(w z) + a_3 P_3(w z), z the way the light travels.

    The phase function keeps of degree l of the arriving radiance, in spherical harmonics, the part g^l
    (Chandrasekhar 1960, section 48): c_0 = mean L, c = 3 g mean(L w'), a_l = (2 l + 1) g^l mean(L P_l(w' z)).
    Of degrees above one only what is round about the light's axis is kept, and of those above three nothing.
    """
    index = mi.UInt32(0)
    moments = [[mi.Float(0) for _ in range(6)] for _ in range(6)]
    while index < samples:
        u, v, offset = stratified(index, rotation)
        travels = sample_henyey_greenstein(u, v, mi.Float(0))
        phase = phases(discs, -travels, g)
        arriving, _ = march(
            sample, source, box, start, -travels, phase, offset=offset, step=step, albedo=albedo, cutoff=_CUTOFF
        )
        moments = add_moments(moments, angular(travels, to_lights), arriving)
        index += 1
    scales = [1.0, 3.0 * g, 3.0 * g, 3.0 * g, 5.0 * g * g, 7.0 * g * g * g]
    return scaled(moments, scales, samples)


def angular(way, to_lights) -> list[Six]:
    """Of light that goes along `way`, what each moment of each light is weighted with: 1, x, y, z, P_2, P_3."""
    cosines = [-dr.dot(way, to_light) for to_light in to_lights]
    second = [1.5 * c * c - 0.5 for c in cosines]
    third = [(2.5 * c * c - 1.5) * c for c in cosines]
    return [[mi.Float(1)] * 6, [way.x] * 6, [way.y] * 6, [way.z] * 6, second, third]


def add_moments(moments: list[Six], weights: list[Six], values: Six) -> list[Six]:
    return [
        [dr.fma(w, value, sum_) for w, value, sum_ in zip(weight, values, total, strict=True)]
        for total, weight in zip(moments, weights, strict=True)
    ]


def scaled(moments: list[Six], scales: list, samples) -> list[Six]:
    return [[scale / mi.Float(samples) * value for value in six] for scale, six in zip(scales, moments, strict=True)]


def stratified(index, rotation):
    """The next two coordinates of a direction and the offset of its ray, in [0, 1)."""
    number = mi.Float(index)
    turned = [dr.fma(number, step, start) for step, start in zip((*_R2, _GOLDEN), rotation, strict=True)]
    return [value - dr.floor(value) for value in turned]


def uniform_triple(index, seed):
    """Three floats in [0, 1) for every index, others for every seed (Tiny Encryption Algorithm, Zafar 2010)."""
    first, second = mi.sample_tea_32(index, seed)
    third, _ = mi.sample_tea_32(second, first)
    return [mi.Float(number >> 8) * 2.0**-24 for number in (first, second, third)]


def sample_henyey_greenstein(u, v, g):
    """A unit vector about +z, distributed as the phase function of its cosine (Witt 1977, eq. 19)."""
    square_root = (1.0 - g * g) / (1.0 - g + 2.0 * g * u)
    anisotropic = (1.0 + g * g - square_root * square_root) / (2.0 * g)
    cosine = dr.clip(dr.select(dr.abs(g) < 1e-3, 2.0 * u - 1.0, anisotropic), -1.0, 1.0)
    sine = dr.safe_sqrt(1.0 - cosine * cosine)
    sin_phi, cos_phi = dr.sincos(dr.two_pi * v)
    return mi.Vector3f(sine * cos_phi, sine * sin_phi, cosine)


def add_weighted(total: Six, weight, values: Six) -> Six:
    return [dr.fma(weight, value, sum_) for value, sum_ in zip(values, total, strict=True)]
