"""Light from all around: six colours, one for each map, from spherical harmonics or a picture of the sky."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.shading.blend import BlendRule, blend_weights

_AXES = np.array([TO_LIGHT[name] for name in DIRECTIONS])


@dataclass(frozen=True, kw_only=True, eq=False)
class Ambient:
    """per_direction: RGB that multiplies each of the six maps, in the order of `DIRECTIONS`."""

    per_direction: Float[np.ndarray, "6 3"]

    def __post_init__(self) -> None:
        if not np.isfinite(self.per_direction).all():
            raise ValueError(f"ambient light needs 6 finite RGB colours, got {self.per_direction}")

    @classmethod
    def from_sh(cls, mean: Float[np.ndarray, "3"], slope: Float[np.ndarray, "3 3"]) -> "Ambient":
        """SH of degree 1 as engines read it: map i gets 4 pi / 6 / pi of mean + slope . axis i.

        mean: RGB. slope: [xyz of the camera frame, RGB]. 4 pi of directions fall to six maps, and M = pi L / E
        (Unity, SixWayLighting.hlsl). Radiance is mean + slope . w: a sky that is the same everywhere is exact.
        """
        return cls(per_direction=4.0 / 6.0 * (np.asarray(mean) + _AXES @ np.asarray(slope)))

    @classmethod
    def from_environment(
        cls, radiance: Float[np.ndarray, "h w 3"], basis: Float[np.ndarray, "3 3"], *, rule: BlendRule = "squared"
    ) -> "Ambient":
        """1 / pi of the integral of radiance x weight of the map: all light of the picture as `rule` spreads it.

        radiance: a lat-long picture as `environment_directions` lays it out, linear. basis: `Camera.basis`.
        """
        towards, solid_angle = environment_directions(*radiance.shape[:2])
        weights = blend_weights(towards @ basis.T, rule) * solid_angle[..., None]
        return cls(per_direction=np.einsum("hwi,hwc->ic", weights, radiance.astype(np.float64)) / math.pi)


def sh_of_environment(
    radiance: Float[np.ndarray, "h w 3"], basis: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Mean and slope of the picture's radiance, camera frame: the nearest mean + slope . w in least squares."""
    towards, solid_angle = environment_directions(*radiance.shape[:2])
    share = solid_angle / solid_angle.sum()
    mean = np.einsum("hw,hwc->c", share, radiance.astype(np.float64))
    slope = 3.0 * np.einsum("hw,hwk,hwc->kc", share, towards @ basis.T, radiance.astype(np.float64))
    return mean, slope


def environment_directions(
    height_px: int, width_px: int
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]:
    """World unit vectors towards the pixels of a lat-long picture, and their solid angles [sr].

    Row 0 is up; the middle column lies at -z, where a camera of yaw 0 looks; to its right is +x.
    """
    polar = math.pi * (np.arange(height_px) + 0.5) / height_px
    around = 2.0 * math.pi * ((np.arange(width_px) + 0.5) / width_px - 0.5)
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
    towards = np.stack(
        [sine * np.sin(around), np.broadcast_to(cosine, (height_px, width_px)), -sine * np.cos(around)], axis=-1
    )
    edges = np.cos(math.pi * np.arange(height_px + 1) / height_px)
    rows = (edges[:-1] - edges[1:]) * 2.0 * math.pi / width_px
    return towards, np.repeat(rows[:, None], width_px, axis=1)
