"""Curves that an artist lays over finished maps: contrast, range, alpha."""

from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from sixway.core.config import Config
from sixway.core.conventions import DIRECTIONS
from sixway.core.records import SixWayLightmap

_LEAST_ALPHA = 1e-5


class Contrast(Config):
    """Two power curves that meet at `pivot`, where the value stays: exponent 2^intensity below it, mirrored above.

    intensity: in [-5, 5], 0 changes nothing. pivot: in [0, 1]. (Unity VFX Graph, parametric contrast.)
    """

    kind: Literal["contrast"] = "contrast"
    intensity: float = Field(default=0.0, ge=-5.0, le=5.0)
    pivot: float = Field(default=0.5, ge=0.0, le=1.0)


class Curve(Config):
    """Straight lines between points (value, result) whose values rise; level before the first and past the last."""

    kind: Literal["curve"] = "curve"
    points: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 1.0))

    @model_validator(mode="after")
    def _rises(self) -> "Curve":
        values = [value for value, _ in self.points]
        if not values or any(b <= a for a, b in pairwise(values)):
            raise ValueError(f"curve points at {values} must rise")
        if any(result < 0.0 for _, result in self.points):
            raise ValueError(f"curve {self.points} must not have negative results")
        return self


class Remap(Config):
    """What is done to straight map values (divided by alpha), in this order, and to alpha.

    from_range: values that become 0 and 1, what lies outside is cut off. shape: contrast or curve on [0, 1].
    to_range: what 0 and 1 become. alpha: curve on alpha; maps are multiplied by the new one. What is left out
    changes nothing, not even values above 1.
    """

    from_range: tuple[float, float] | None = None
    shape: Contrast | Curve | None = Field(default=None, discriminator="kind")
    to_range: tuple[float, float] | None = None
    alpha: Curve | None = None

    @model_validator(mode="after")
    def _ranges(self) -> "Remap":
        if self.from_range is not None and not self.from_range[0] < self.from_range[1]:
            raise ValueError(f"from_range {self.from_range} must rise")
        if self.to_range is not None and min(self.to_range) < 0.0:
            raise ValueError(f"to_range {self.to_range} must not be negative")
        return self


def remapped(lightmap: SixWayLightmap, remap: Remap) -> SixWayLightmap:
    """The lightmap with its maps and alpha laid through the curves; emissive stays."""
    alpha = lightmap["alpha"].astype(np.float64)
    straight = lightmap.maps / np.maximum(alpha, _LEAST_ALPHA)[..., None]
    new_alpha = alpha if remap.alpha is None else np.clip(_shaped(alpha, remap.alpha), 0.0, 1.0)
    image = lightmap.image.copy()
    image[..., : len(DIRECTIONS)] = remap_values(straight, remap) * np.where(alpha > 0.0, new_alpha, 0.0)[..., None]
    image[..., lightmap.channels.index("alpha")] = new_alpha
    return SixWayLightmap(channels=lightmap.channels, image=image)


def remap_values(straight: Float[np.ndarray, "*n"], remap: Remap) -> Float[np.ndarray, "*n"]:
    """The three steps of `Remap` on straight values."""
    values = np.asarray(straight, np.float64)
    if remap.from_range is not None:
        low, high = remap.from_range
        values = np.clip((values - low) / (high - low), 0.0, 1.0)
    if remap.shape is not None:
        values = _shaped(values, remap.shape)
    if remap.to_range is not None:
        low, high = remap.to_range
        values = low + (high - low) * values
    return np.maximum(values, 0.0)


def _shaped(values: Float[np.ndarray, "*n"], shape: Contrast | Curve) -> Float[np.ndarray, "*n"]:
    match shape:
        case Contrast(intensity=intensity, pivot=pivot):
            above = values > pivot
            side = np.where(above, 1.0 - pivot, pivot)
            away = np.clip(np.where(above, 1.0 - values, values), 0.0, 1.0)
            result = side * (away / np.maximum(side, 1e-6)) ** 2.0**intensity
            return np.where(above, 1.0 - result, result)
        case Curve(points=points):
            places, results = zip(*points, strict=True)
            return np.interp(values, places, results)
