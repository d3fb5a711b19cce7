"""How much each of the six maps counts for light from one direction (Eq. 5 and what engines make of it)."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, TO_LIGHT

BlendRule = Literal["squared", "paper_abs", "abs_normalised", "smoothstep"]

_AXES = np.array([TO_LIGHT[name] for name in DIRECTIONS])


def blend_weights(to_light: Float[np.ndarray, "*n 3"], rule: BlendRule) -> Float[np.ndarray, "*n 6"]:
    """Weights of the six maps, in the order of `DIRECTIONS`, for unit vectors in the camera frame; float64.

    At most three are not 0. squared: w^2, sums to 1 (Unity HDRP and URP). paper_abs: |w| as Eq. 5 prints it, sums
    to 1.73 on a diagonal. abs_normalised: |w| / sum (Godot). smoothstep: 3 w^2 - 2 |w|^3, sums to 1.85 on a
    diagonal (EmberGen shaders).
    """
    part = np.maximum(np.asarray(to_light, np.float64) @ _AXES.T, 0.0)
    match rule:
        case "squared":
            return part * part
        case "paper_abs":
            return part
        case "abs_normalised":
            return part / part.sum(axis=-1, keepdims=True)
        case "smoothstep":
            return part * part * (3.0 - 2.0 * part)
