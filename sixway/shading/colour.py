"""Smoke that is not white: its maps are white, its colour comes afterwards, and cheaply."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

_REFERENCE = 0.2
"""The colour that squares what arrives (Unity, SixWayLighting.hlsl)."""


@dataclass(frozen=True, kw_only=True)
class SmokeColour:
    """rgb: linear, >= 0. mode: how it dyes the light.

    ``multiply``: light times colour. ``absorption``: light that went far through the smoke, which is what dark
    parts of the maps hold, loses more of what the colour lacks. Of `strength` (0 to 1, beyond is cut off) 0 takes a
    map of 1 for light that was not absorbed at all, 1 one of pi.
    """

    rgb: tuple[float, float, float] = (1.0, 1.0, 1.0)
    mode: Literal["multiply", "absorption"] = "multiply"
    strength: float = 0.5

    def __post_init__(self) -> None:
        if not all(math.isfinite(part) and part >= 0.0 for part in self.rgb):
            raise ValueError(f"smoke colour {self.rgb} must be finite and not negative")
        if self.mode == "absorption" and max(self.rgb) > 1.0:
            raise ValueError(f"smoke colour {self.rgb} must not exceed 1 to absorb; brighten the lights instead")


WHITE = SmokeColour()


def coloured(
    light: Float[np.ndarray, "*n"], alpha: Float[np.ndarray, "*n"], colour: SmokeColour
) -> Float[np.ndarray, "*n 3"]:
    """Premultiplied map values, dyed, in their own precision. light: a map, or one light's weighted sum of six."""
    rgb = np.array(colour.rgb, light.dtype)
    if colour.mode == "multiply":
        return light[..., None] * rgb
    # premultiplied light cannot exceed its alpha's part of the range; where alpha is 0 so is the light
    full = _unabsorbed(colour.strength) * np.where(alpha > 0.0, alpha, 1.0)
    exponent = 1.0 + np.log(np.maximum(rgb, 1e-5)) / math.log(_REFERENCE)
    return (full[..., None] * np.clip(light / full, 0.0, 1.0)[..., None] ** exponent).astype(light.dtype)


def _unabsorbed(strength: float) -> float:
    """The map value that counts as not absorbed: pi (1/pi + s (1 - 1/pi))."""
    return 1.0 + min(max(strength, 0.0), 1.0) * (math.pi - 1.0)
