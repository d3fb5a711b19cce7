"""Free flights through smoke of varying density, exact in expectation: delta and ratio tracking.

Both fill the smoke up with null particles to a constant extinction, the `majorant`, whose free flights
are exponential (Woodcock et al. 1965). Majorants must not be below sigma_t anywhere and may not be zero.
"""

import drjit as dr
import mitsuba as mi

from sixway.reference.kernels import Box

_THIN = 0.1
"""Transmittance below which ratio tracking ends rays by chance: their full length would cost more than it tells."""


@dr.syntax
def delta_tracked(sigma_t, box: Box, origin, direction, start, end, majorant, random, active):
    """Distances [m] of the first real collisions between `start` and `end`, and whether there was one."""
    distance = mi.Float(start)
    collided = mi.Bool(False)
    flying = mi.Bool(active)
    while flying:
        distance -= dr.log(1.0 - random.next_float32()) / majorant
        flying = distance < end
        real = random.next_float32() * majorant < sigma_t.eval(box.to_texture(origin + distance * direction))[0]
        collided = flying & real
        flying &= ~real
    return distance, collided


@dr.syntax
def ratio_tracked(sigma_t, box: Box, origin, direction, majorant, random, active):
    """Estimates of the transmittance from each point to the box's face (Novak et al. 2014, ratio tracking)."""
    _, end = box.span(origin, direction)
    distance = mi.Float(0)
    transmittance = mi.Float(1)
    flying = mi.Bool(active)
    while flying:
        distance -= dr.log(1.0 - random.next_float32()) / majorant
        flying = distance < end
        real = sigma_t.eval(box.to_texture(origin + distance * direction))[0] / majorant
        absorbed = random.next_float32() < real
        passed = dr.select(transmittance > _THIN, 1.0 - real, dr.select(absorbed, 0.0, 1.0))
        transmittance = dr.select(flying, transmittance * passed, transmittance)
        flying &= transmittance > 0.0
    return transmittance
