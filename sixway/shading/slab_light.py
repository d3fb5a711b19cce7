"""A lamp in the smoke or near it, with the six maps of a sprite and the slab behind each pixel.

One direction a pixel is wrong in two ways. Where the lamp stands amid a column, light comes from behind to its front
and from the front to its back: so each column is lit in steps. Each map holds what comes from its side over the whole
column, and even smoke says how that spreads over the steps: side maps fall off with depth as the camera's own view
does; the front map twice as fast, for its light has come the same way; the back map is even, for what is lost before
a step and behind it adds up to the same. And maps have lost light on the whole way from outside, where a lamp at a
distance d loses it over d only: so no step gets less than even smoke leaves over d. That least light is isotropic
whatever the maps are: of smoke that scatters forwards it is too much where the lamp is on the camera's side.

Where the lamp is far away the steps are lit alike, their shares add up to 1, and the light is the plain mix of maps.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from sixway.core.conventions import DIRECTIONS
from sixway.core.records import SixWayLightmap
from sixway.shading.blend import BlendRule, blend_weights
from sixway.shading.light import NearLight
from sixway.shading.near import middle_of, nearest_point, strength_at
from sixway.shading.slab import SmokeSlab
from sixway.shading.surface import project

Plane = Float[np.ndarray, "h w"]

_STEPS = 16
_SIDE, _FRONT, _BACK = (DIRECTIONS.index(name) for name in ("right", "front", "back"))


def slab_light(light: NearLight, lightmap: SixWayLightmap, slab: SmokeSlab, rule: BlendRule) -> tuple[Plane, Plane]:
    """The lamp's map, and the mean strength (`strength_at`) that it stands for, float64.

    Pixels show map * strength * colour / pi. Raises ValueError for a slab that is not as large as the lightmap.
    """
    maps, alpha = lightmap.maps, lightmap["alpha"].astype(np.float64)
    if slab.begins_m.shape != alpha.shape:
        raise ValueError(f"slab of {slab.begins_m.shape} px for a lightmap of {alpha.shape} px; they must be alike")
    origins, towards = slab.camera.rays()
    middle = origins + (slab.begins_m + 0.5 * slab.thickness_m)[..., None] * towards
    extinction = _extinction_to(light, slab, alpha)
    lit, mean = np.zeros_like(alpha), np.zeros_like(alpha)
    for at_m, shares in _steps(slab, nearest_point(light, middle), origins, towards):
        points = origins + at_m[..., None] * towards
        to_light, strength = strength_at(light, points)
        mixed = (maps * shares * blend_weights(to_light @ slab.camera.basis.T, rule)).sum(axis=-1)
        depth = extinction * np.linalg.norm(nearest_point(light, points) - points, axis=-1)
        seen = shares[..., _SIDE]
        lit += np.maximum(mixed, alpha * seen * map_in_smoke(depth, alpha, slab.albedo)) * strength
        mean += seen * strength
    return lit / np.maximum(mean, 1e-30), mean


def map_in_smoke(
    optical_depth: Float[np.ndarray, "*n"], alpha: Float[np.ndarray, "*n"], albedo: float
) -> Float[np.ndarray, "*n"]:
    """M = pi L / E of opaque smoke whose light has come through that much even smoke; isotropic.

    albedo e^-x / 4 scatters once. Light that scatters twice grows with x at first (as 2.5 x in white smoke without
    end) and is taken to end at as much; smoke through which one sees, of lower `alpha`, has less of it.
    """
    return 0.25 * albedo * np.exp(-optical_depth) * (1.0 - albedo * alpha * np.expm1(-2.0 * optical_depth))


def _steps(
    slab: SmokeSlab,
    focus: Float[np.ndarray, "h w 3"],
    origins: Float[np.ndarray, "h w 3"],
    towards: Float[np.ndarray, "h w 3"],
) -> Iterator[tuple[Plane, Float[np.ndarray, "h w 6"]]]:
    """Depths along the rays, and the part of each map that belongs there.

    Steps are of equal angle as the lamp sees them (Kulla, Fajardo 2012): short where it is near.
    """
    thickness, extinction = slab.thickness_m, slab.extinction_per_m
    foot = ((focus - origins) * towards).sum(axis=-1)
    miss = np.linalg.norm(focus - origins - foot[..., None] * towards, axis=-1)
    foot = foot - slab.begins_m
    # from a lamp before or behind the slab they are nearly even; a floor keeps a ray through the lamp finite
    scale = np.maximum(np.maximum(miss, 0.01 * thickness), np.maximum(-foot, foot - thickness))
    first, last = np.arctan(-foot / scale), np.arctan((thickness - foot) / scale)
    through = np.exp(-slab.optical_depth)

    def place(share: float) -> Plane:
        angle = first + share * (last - first)
        return np.clip(foot + scale * np.tan(angle), 0.0, thickness)

    begin, seen = np.zeros_like(thickness), np.ones_like(thickness)
    for number in range(_STEPS):
        end = place((number + 1) / _STEPS)
        left = np.exp(-extinction * end)
        side = (seen - left) / (1.0 - through)
        shares = np.repeat(side[..., None], len(DIRECTIONS), axis=-1)
        shares[..., _FRONT] *= (seen + left) / (1.0 + through)
        shares[..., _BACK] = (end - begin) / thickness
        yield slab.begins_m + place((number + 0.5) / _STEPS), shares
        begin, seen = end, left


def _extinction_to(light: NearLight, slab: SmokeSlab, alpha: Plane) -> Plane:
    """Extinction [1/m] between each pixel's smoke and the lamp: the mean of both ends, the pixel's by its opacity.

    At the lamp it is that of the lamp's column, or the picture's mean as far as there is no smoke: a thin edge does
    not tell how dense the smoke is that light has come through.
    """
    own = slab.extinction_per_m
    at_lamp = (alpha * own).sum() / np.maximum(alpha.sum(), 1e-6)
    pixel, depth = project(slab.camera, middle_of(light)[None])
    if depth[0] > 0.0:
        at = [[pixel[0, 1] - 0.5], [pixel[0, 0] - 0.5]]
        opacity, lamps = (
            map_coordinates(plane, at, order=1, mode="grid-constant")[0] for plane in (alpha, alpha * own)
        )
        at_lamp = lamps + (1.0 - opacity) * at_lamp
    return (alpha * own + at_lamp) / (alpha + 1.0)
