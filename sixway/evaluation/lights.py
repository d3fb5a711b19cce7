"""The lights of the scores and of the pictures, fixed, in the camera frame: they stay where the viewer is."""

import math

import numpy as np
from jaxtyping import Float

from sixway.shading.blend import blend_weights
from sixway.shading.light import DirectionalLight

_LIGHTS = 16


def _spread(number: int) -> tuple[DirectionalLight, ...]:
    """White lights all around: a Fibonacci sphere (Gonzalez 2010, Eq. 1), from the top down.

    Of 16, neighbours are 45 to 49 degrees apart and none is nearer than 18 degrees to one of the six
    lights that the maps themselves are of.
    """
    golden_angle = math.pi * (3.0 - math.sqrt(5.0))
    lights = []
    for i in range(number):
        y = 1.0 - (2.0 * i + 1.0) / number
        radius = math.sqrt(1.0 - y * y)
        at = (radius * math.cos(golden_angle * i), y, radius * math.sin(golden_angle * i))
        lights.append(DirectionalLight(to_light=at))
    return tuple(lights)


SCORE_LIGHTS = _spread(_LIGHTS)
"""The 16 white lights, one at a time, of the shaded scores."""

PERCEIVED_LIGHTS = tuple(range(1, _LIGHTS, 4))
"""Which of them SSIM and FLIP look at: above in front, right behind, left in front, below behind."""

PICTURE_LIGHTS: dict[str, tuple[DirectionalLight, ...]] = {
    "sun from the right": (DirectionalLight.parse("right,1.0,0.95,0.85"),),
    "moon from the top left": (DirectionalLight.parse("-1:1:0.3,0.75,0.85,1.0"),),
    "back light": (DirectionalLight.parse("0.3:0.4:-1,1.6,1.3,1.0"),),
    "red below, blue above": (
        DirectionalLight.parse("bottom,1.0,0.25,0.1"),
        DirectionalLight.parse("0.2:1:0.5,0.3,0.5,1.0"),
    ),
}
"""Coloured lights for the contact sheets, never scored."""


def score_weights() -> Float[np.ndarray, "6 16"]:
    """What each map gives to the picture under each of the `SCORE_LIGHTS` (rule `squared`, as the shaders do)."""
    to_light = np.array([light.to_light for light in SCORE_LIGHTS])
    return blend_weights(to_light, "squared").T.astype(np.float32)
