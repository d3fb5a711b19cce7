"""Six maps and some lights to a picture (Eq. 5), and the picture over a background (Eq. 4)."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.core.frames import Vector
from sixway.core.records import SixWayLightmap
from sixway.shading.fire import ArtistRamp, BlackBodyRamp, fire_colour
from sixway.shading.light import DirectionalLight

BlendRule = Literal["squared", "paper_abs", "abs_normalised", "smoothstep"]

_FIRE = BlackBodyRamp()


def blend_weights(to_light: Vector, rule: BlendRule) -> dict[str, float]:
    """Weight of each of the six maps for a unit `to_light` in the camera frame; at most three are not 0.

    squared: w^2, sums to 1 (Unity HDRP and URP). paper_abs: |w| as Eq. 5 prints it, sums to 1.73 on a
    diagonal. abs_normalised: |w| / sum (Godot). smoothstep: 3 w^2 - 2 |w|^3, sums to 1.85 on a diagonal
    (EmberGen shaders).
    """
    parts = {name: max(0.0, float(np.dot(to_light, axis))) for name, axis in TO_LIGHT.items()}
    match rule:
        case "squared":
            return {name: part * part for name, part in parts.items()}
        case "paper_abs":
            return parts
        case "abs_normalised":
            total = sum(parts.values())
            return {name: part / total for name, part in parts.items()}
        case "smoothstep":
            return {name: part * part * (3.0 - 2.0 * part) for name, part in parts.items()}


def shade(
    lightmap: SixWayLightmap,
    lights: Sequence[DirectionalLight],
    *,
    rule: BlendRule = "squared",
    fire: BlackBodyRamp | ArtistRamp = _FIRE,
) -> Float[np.ndarray, "h w 3"]:
    """Linear RGB of the smoke on black (alpha-premultiplied), float32.

    Each light adds colour * sum_i w_i M_i; an emissive channel adds its light
    in the colours of the ramp `fire`.
    """
    per_direction = np.zeros((len(DIRECTIONS), 3), np.float32)
    for light in lights:
        weights = blend_weights(light.to_light, rule)
        for i, name in enumerate(DIRECTIONS):
            per_direction[i] += weights[name] * np.array(light.colour, np.float32)
    image = lightmap.maps @ per_direction
    if "emissive" in lightmap.channels:
        image = image + fire_colour(lightmap["emissive"], fire)
    return image.astype(np.float32)


def over(
    premultiplied: Float[np.ndarray, "h w 3"],
    alpha: Float[np.ndarray, "h w"],
    background: Float[np.ndarray, "h w 3"],
) -> Float[np.ndarray, "h w 3"]:
    """The smoke in front of a background: image + T * background (Eq. 4), linear RGB."""
    return premultiplied + (1.0 - alpha[..., None]) * background
