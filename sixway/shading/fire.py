"""The colour of fire: one channel of emissive to linear RGB, through a ramp that is no part of the maps.

A ramp reads a map value as a place between 0 and 1: 1, or `full` where a picture is made, is the hottest fire.
"""

from functools import cache
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from sixway.core.config import Config

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB (ITU-R BT.709)
_XYZ_TO_RGB = np.array(  # IEC 61966-2-1
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
_TEMPERATURES = 64  # kept of a black-body ramp; between them colours are interpolated


class BlackBodyRamp(Config):
    """What glowing soot looks like: its colour is that of a black body, its luminance the map's value.

    coldest_k, hottest_k: temperatures [K] that the values 0 and 1 stand for, evenly in between. Values above 1
    grow brighter and keep the hottest colour. Soot burns at 1000 to 2000 K; above, fire looks whiter than it is.
    """

    kind: Literal["black_body"] = "black_body"
    coldest_k: float = Field(default=1000.0, ge=700.0, le=40000.0)
    hottest_k: float = Field(default=3000.0, ge=700.0, le=40000.0)

    @model_validator(mode="after")
    def _in_order(self) -> "BlackBodyRamp":
        if not self.coldest_k < self.hottest_k:
            raise ValueError(f"coldest_k {self.coldest_k} must lie below hottest_k {self.hottest_k}")
        return self


class ArtistRamp(Config):
    """Colours chosen by hand: stops of (value, linear RGB), evenly blended in between.

    Below the first stop the colour fades to black, above the last it grows brighter.
    """

    kind: Literal["artist"] = "artist"
    stops: tuple[tuple[float, tuple[float, float, float]], ...] = (
        (0.05, (0.06, 0.003, 0.0)),  # dark red
        (0.35, (0.8, 0.16, 0.01)),  # orange
        (0.7, (1.3, 0.75, 0.12)),  # yellow
        (1.0, (1.8, 1.6, 1.2)),  # white
    )

    @model_validator(mode="after")
    def _stops_rise(self) -> "ArtistRamp":
        values = [value for value, _ in self.stops]
        if not values or values[0] <= 0.0 or any(b <= a for a, b in pairwise(values)):
            raise ValueError(f"stops at {values} must rise, the first one above 0")
        if any(part < 0.0 for _, colour in self.stops for part in colour):
            raise ValueError(f"stops {self.stops} must not have negative colours")
        return self


FireRamp = Annotated[BlackBodyRamp | ArtistRamp, Field(discriminator="kind")]


def fire_colour(
    emissive: Float[np.ndarray, "h w"], ramp: BlackBodyRamp | ArtistRamp, *, full: float = 1.0
) -> Float[np.ndarray, "h w 3"]:
    """Linear RGB of an emissive map, float32. full: the map's value that the ramp takes for 1, > 0."""
    if not full > 0.0:
        raise ValueError(f"full {full} must be positive: it is the emissive value of the hottest fire")
    value = np.asarray(emissive, np.float64) / full
    match ramp:
        case BlackBodyRamp():
            places = np.linspace(0.0, 1.0, _TEMPERATURES)
            table = _ramp_colours(ramp.coldest_k, ramp.hottest_k)
            bright = np.asarray(emissive, np.float64)
        case ArtistRamp():
            places = np.array([0.0] + [place for place, _ in ramp.stops])
            table = np.array([(0.0, 0.0, 0.0)] + [colour for _, colour in ramp.stops])
            bright = full * np.maximum(value / places[-1], 1.0)
    colour = np.stack([np.interp(value, places, table[:, channel]) for channel in range(3)], axis=-1)
    return (bright[..., None] * colour).astype(np.float32)


@cache
def _ramp_colours(coldest_k: float, hottest_k: float) -> Float[np.ndarray, "n 3"]:
    return black_body_rgb(np.linspace(coldest_k, hottest_k, _TEMPERATURES))


def black_body_rgb(temperature_k: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Linear sRGB of luminance 1 with the chromaticity of black bodies of those temperatures, float64.

    Parts below 0, which sRGB cannot show (blue, and below 1900 K green a little), are cut off.
    """
    rgb = np.maximum(_black_body_xyz(temperature_k) @ _XYZ_TO_RGB.T, 0.0)
    return rgb / (rgb @ _LUMINANCE)[:, None]


def _black_body_xyz(temperature_k: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """CIE 1931 tristimulus values of Planck's law, each row divided by its sum."""
    wavelength = np.arange(360.0, 831.0, 2.0)
    # second radiation constant 1.438777e7 nm K (CODATA 2018); the first one cancels
    radiance = wavelength**-5 / np.expm1(1.438777e7 / np.multiply.outer(temperature_k, wavelength))
    xyz = radiance @ np.stack(_colour_matching(wavelength), axis=-1)
    return xyz / xyz.sum(axis=-1, keepdims=True)


def _colour_matching(nm: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y, z of the CIE 1931 observer: Wyman, Sloan, Shirley 2013, JCGT 2(2), the multi-lobe fit (Eq. 4)."""

    def lobe(height: float, centre: float, below: float, above: float) -> np.ndarray:
        return height * np.exp(-0.5 * ((nm - centre) / np.where(nm < centre, below, above)) ** 2)

    return (
        lobe(1.056, 599.8, 37.9, 31.0) + lobe(0.362, 442.0, 16.0, 26.7) + lobe(-0.065, 501.1, 20.4, 26.2),
        lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
        lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
    )
