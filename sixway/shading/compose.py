"""Six maps and some lights to a picture (Eq. 5), and the picture over a background (Eq. 4)."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sixway.core.records import SixWayLightmap
from sixway.shading.ambient import Ambient
from sixway.shading.blend import BlendRule, blend_weights
from sixway.shading.colour import WHITE, SmokeColour, coloured
from sixway.shading.fire import ArtistRamp, BlackBodyRamp, fire_colour
from sixway.shading.light import DirectionalLight, Light
from sixway.shading.near import arriving, colour_of
from sixway.shading.slab import SmokeSlab
from sixway.shading.slab_light import slab_light
from sixway.shading.surface import SmokeSurface

_FIRE = BlackBodyRamp()


def shade(
    lightmap: SixWayLightmap,
    lights: Sequence[Light],
    *,
    rule: BlendRule = "squared",
    surface: SmokeSurface | SmokeSlab | None = None,
    visible: Sequence[Float[np.ndarray, "h w"]] | None = None,
    ambient: Ambient | None = None,
    colour: SmokeColour = WHITE,
    fire: BlackBodyRamp | ArtistRamp = _FIRE,
    emissive_map: Float[np.ndarray, "h w 3"] | None = None,
) -> Float[np.ndarray, "h w 3"]:
    """Linear RGB of the smoke on black (alpha-premultiplied), float32.

    Each light adds its colour * sum_i w_i M_i, dyed by `colour`; lamps, which stand in the world, take direction and
    distance from `surface`, and from a `SmokeSlab` also what smoke around them shows, should they stand inside it.
    visible: one [h, w] picture in [0, 1] for each light, what obstacles leave of it.
    Fire adds its light: the emissive channel in the colours of the ramp `fire`, or `emissive_map`, linear RGB, in
    its place. Raises ValueError for lamps without a surface and for pictures that do not match.
    """
    maps, alpha = lightmap.maps, lightmap["alpha"]
    if visible is not None and len(visible) != len(lights):
        raise ValueError(f"{len(visible)} pictures of visibility for {len(lights)} lights; give one for each")
    image = np.zeros((*alpha.shape, 3), np.float32)
    for number, light in enumerate(lights):
        arrived, shown = map_of(light, lightmap, surface, rule)
        lit = coloured(arrived.astype(np.float32), alpha, colour) * shown.astype(np.float32)
        image += lit if visible is None else visible[number].astype(np.float32)[..., None] * lit
    if ambient is not None:
        for number, sky in enumerate(ambient.per_direction):
            image += coloured(maps[..., number], alpha, colour) * sky.astype(np.float32)
    if emissive_map is not None:
        image += emissive_map
    elif "emissive" in lightmap.channels:
        image += fire_colour(lightmap["emissive"], fire)
    return image


def map_of(
    light: Light, lightmap: SixWayLightmap, surface: SmokeSurface | SmokeSlab | None, rule: BlendRule
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "*n 3"]]:
    """The maps weighted for one light, and what a white Lambertian facing the light shows: RGB, [3] of a sun, else
    [h, w, 3].

    Raises ValueError for a lamp without a surface, and for a `SmokeSlab` of another size.
    """
    if isinstance(light, DirectionalLight):
        return lightmap.maps @ blend_weights(np.array(light.to_light), rule).astype(np.float32), np.array(light.colour)
    if surface is None:
        raise ValueError(f"{type(light).__name__} stands in the world: give `surface`, from the guide's depth")
    if isinstance(surface, SmokeSlab):
        arrived, strength = slab_light(light, lightmap, surface, rule)
        return arrived, strength[..., None] * np.array(colour_of(light)) / math.pi
    to_light, irradiance = arriving(light, surface.points_m)
    weights = blend_weights(to_light @ surface.camera.basis.T, rule).astype(np.float32)
    return np.einsum("hwi,hwi->hw", lightmap.maps, weights), irradiance / math.pi


def over(
    premultiplied: Float[np.ndarray, "h w 3"],
    alpha: Float[np.ndarray, "h w"],
    background: Float[np.ndarray, "h w 3"],
) -> Float[np.ndarray, "h w 3"]:
    """The smoke in front of a background: image + T * background (Eq. 4), linear RGB."""
    return premultiplied + (1.0 - alpha[..., None]) * background
