"""Closed forms of the six maps, float64: single scattering in a homogeneous cube, light for light."""

import math

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS


def cube_maps(
    optical_depth: float, *, albedo: float, voxels: int, pixels: int
) -> dict[str, Float[np.ndarray, " pixels"]]:
    """M = pi L / E of a cube of `voxels` a side whose image, orthographic, has `pixels` a side.

    One value per column for right and left, per row for the other lights, from the left or from the top:
    L = albedo / (4 pi) times the integral of sigma_t exp(-(way in + way out)) along the ray. Valid two pixels
    from the image's border. Interpolation turns each face into a ramp one voxel wide, which light from the
    side passes on its way; for light from the front and the back it changes nothing.
    """
    s, ramp_width = optical_depth, 1.0 / voxels
    z = np.linspace(-0.5 * ramp_width, 1.0 + 0.5 * ramp_width, 20001)
    ramp = np.clip(np.minimum(z, 1.0 - z) / ramp_width + 0.5, 0.0, 1.0)
    way_out = s * np.cumsum(ramp) * (z[1] - z[0])
    depth = (np.arange(pixels) + 0.5) / pixels
    side = albedo / 4.0 * s * np.trapezoid(ramp * np.exp(-way_out - s * np.outer(depth, ramp)), z, axis=-1)
    maps = {
        "front": np.full(pixels, albedo / 4.0 * (1.0 - math.exp(-2.0 * s)) / 2.0),
        "back": np.full(pixels, albedo / 4.0 * s * math.exp(-s)),
        "left": side,
        "right": side[::-1],
        "top": side,
        "bottom": side[::-1],
    }
    return {name: maps[name] for name in DIRECTIONS}
