"""The arithmetic of the cached reference, traced by Dr.Jit: rays, phase function, march, directions.

Every number that may differ between calls arrives as an opaque array of width 1, never as a Python
number: Dr.Jit bakes those into the kernel and would compile a new one for every seed or camera.
"""

from collections.abc import Callable

import drjit as dr
import mitsuba as mi

_R2 = (0.7548776662466927, 0.5698402909980532)  # 1/p and 1/p^2, p^3 = p + 1 (Roberts 2018, the R2 sequence)

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


def phases(to_lights, ray, g) -> Six:
    """Phase function [1/sr] of the six lights towards the origin of a ray that looks along `ray`.

    Light travels along -to_light and leaves along -ray: both signs cancel.
    """
    return [henyey_greenstein(dr.dot(to_light, ray), g) for to_light in to_lights]


def sunlight(fields, phase: Six) -> Six:
    """In-scattered radiance [1/sr per unit irradiance] of the six lights, from their optical depths."""
    return [p * dr.exp(-tau) for p, tau in zip(phase, fields[1:7], strict=True)]


def scattered_light(fields, phase: Six) -> Six:
    """In-scattered radiance that a grid of scattered light already holds."""
    return fields[1:7]


@dr.syntax
def optical_depth(volume, box: Box, start, direction):
    """Optical depth from each point to the box's face: midpoint rule, steps of one voxel."""
    _, far = box.span(start, direction)
    depth = mi.Float(0)
    distance = 0.5 * box.voxel
    while distance < far:
        depth += volume.eval(box.to_texture(start + distance * direction))[0]
        distance += box.voxel
    return depth * box.voxel


@dr.syntax
def march(sample: Callable, source: Source, box: Box, origin, direction, phase: Six, *, offset, step, albedo, cutoff):
    """Radiance of the six lights against each ray, and the ray's transmittance.

    L_k = sum_n T_{n-1} (1 - exp(-sigma_t h)) albedo source_k,  T_n = T_{n-1} exp(-sigma_t h)

    sample(world point) -> fields, fields[0] = sigma_t [1/m], and whether the ray ends there.
    offset: where in its step, [0, 1), each ray looks. step: h [m]. The step that takes the transmittance
    below `cutoff` counts as opaque: to end there without it would lose light at every bounce.
    """
    near, far = box.span(origin, direction)
    distance = near + offset * step
    transmittance = mi.Float(1)
    radiance = [mi.Float(0) for _ in range(6)]
    active = distance < far
    while active:
        fields, blocked = sample(origin + distance * direction)
        passed = dr.exp(-fields[0] * step)
        passed = dr.select(transmittance * passed < cutoff, 0.0, passed)
        passed = dr.select(blocked, 1.0, passed)
        weight = transmittance * (1.0 - passed) * albedo
        radiance = add_weighted(radiance, weight, source(fields, phase))
        transmittance *= passed
        distance += step
        active = (distance < far) & (transmittance > 0.0) & ~blocked
    return radiance, transmittance


@dr.syntax
def gathered(sample, source: Source, box: Box, start, outgoing, to_lights, *, step, rotation, samples, g, albedo):
    """In-scattered radiance at each point: the mean over `samples` directions of what arrives there.

    Directions follow the phase function around `outgoing` (unit vectors, the way the light leaves), so
    that the mean needs no weight; `rotation` (two floats in [0, 1)) turns the R2 sequence of each point.
    """
    index = mi.UInt32(0)
    total = [mi.Float(0) for _ in range(6)]
    frame = mi.Frame3f(outgoing)
    while index < samples:
        number = mi.Float(index)
        u = dr.fma(number, _R2[0], rotation[0])
        v = dr.fma(number, _R2[1], rotation[1])
        ray = -frame.to_world(sample_henyey_greenstein(u - dr.floor(u), v - dr.floor(v), g))
        phase = phases(to_lights, ray, g)
        arriving, _ = march(
            sample,
            source,
            box,
            start,
            ray,
            phase,
            offset=0.5,
            step=step,
            albedo=albedo,
            cutoff=_CUTOFF,
        )
        total = add_weighted(total, mi.Float(1), arriving)
        index += 1
    return [value / mi.Float(samples) for value in total]


def uniform_pair(index, seed):
    """Two floats in [0, 1) for every index, others for every seed (Tiny Encryption Algorithm, Zafar 2010)."""
    first, second = mi.sample_tea_32(index, seed)
    return mi.Float(first >> 8) * 2.0**-24, mi.Float(second >> 8) * 2.0**-24


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
