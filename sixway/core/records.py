"""What the stages hand to one another. Each record checks itself once, when it is made."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.frames import Grid


def check_array(name: str, array: np.ndarray, *, shape: tuple[int, ...], minimum: float | None = None) -> None:
    """Raise ValueError unless `array` is finite float32 of that shape with no value below `minimum`."""
    if array.dtype != np.float32:
        raise ValueError(f"{name} has dtype {array.dtype}; convert it to float32")
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    lowest, highest = (float(array.min()), float(array.max())) if array.size else (0.0, 0.0)
    if not (math.isfinite(lowest) and math.isfinite(highest)):
        bad = int(np.count_nonzero(~np.isfinite(array)))
        raise ValueError(f"{name} holds {bad} NaN or infinite values; repair the source")
    if minimum is not None and lowest < minimum:
        bad = int(np.count_nonzero(array < minimum))
        raise ValueError(f"{name} holds {bad} values below {minimum} (lowest {lowest:g}); repair the source")


@dataclass(frozen=True, kw_only=True)
class DensityFrame:
    """Smoke at one moment. density: [z, y, x] float32, >= 0, unitless; `Medium` gives it extinction.

    velocity_m_s: the wind on a grid that may be coarser, [z', y', x', 3] (x, y, z components) over the
    same box, or None. obstacle: [z, y, x] float32 in [0, 1], the solid fraction, or None. emission:
    [z, y, x] float32 >= 0, radiance that fire adds a metre along a ray [1/m], or None.
    Raises ValueError for wrong shapes, NaN, or negative density.
    """

    density: Float[np.ndarray, "z y x"]
    grid: Grid
    time_s: float = 0.0
    velocity_m_s: Float[np.ndarray, "vz vy vx 3"] | None = None
    obstacle: Float[np.ndarray, "z y x"] | None = None
    emission: Float[np.ndarray, "z y x"] | None = None

    def __post_init__(self) -> None:
        check_array("density", self.density, shape=self.grid.shape_zyx, minimum=0.0)
        if self.velocity_m_s is not None:
            if self.velocity_m_s.ndim != 4 or self.velocity_m_s.shape[-1] != 3:
                raise ValueError(f"velocity has shape {self.velocity_m_s.shape}, expected [z, y, x, 3]")
            check_array("velocity", self.velocity_m_s, shape=self.velocity_m_s.shape)
        if self.obstacle is not None:
            check_array("obstacle", self.obstacle, shape=self.grid.shape_zyx, minimum=0.0)
        if self.emission is not None:
            check_array("emission", self.emission, shape=self.grid.shape_zyx, minimum=0.0)


@dataclass(frozen=True, kw_only=True)
class Medium:
    """How smoke meets light. sigma_t = density * extinction_per_m.

    extinction_per_m: extinction [1/m] of density 1. albedo: sigma_s / sigma_t in [0, 1], one number or one
    each for red, green and blue, which only `sixway.reference` takes. hg_g: Henyey-Greenstein anisotropy
    in [-0.95, 0.95].
    """

    extinction_per_m: float
    albedo: float | tuple[float, float, float] = 1.0
    hg_g: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.extinction_per_m) and self.extinction_per_m >= 0.0):
            raise ValueError(f"extinction {self.extinction_per_m} 1/m must be finite and not negative")
        colours = self.albedo if isinstance(self.albedo, tuple) else (self.albedo,)
        if len(colours) not in (1, 3) or not all(0.0 <= colour <= 1.0 for colour in colours):
            raise ValueError(f"albedo {self.albedo} must be one number in [0, 1], or three: red, green, blue")
        if not -0.95 <= self.hg_g <= 0.95:
            raise ValueError(f"hg_g {self.hg_g} must lie in [-0.95, 0.95]")

    @property
    def grey_albedo(self) -> float:
        """The albedo of grey smoke. Raises ValueError for smoke whose albedo is RGB."""
        if isinstance(self.albedo, tuple):
            raise ValueError(
                f"albedo {self.albedo} is RGB where one number is needed; take the three media of `by_colour` in "
                "turn, as sixway.reference.lightmaps.trace_rgb_lightmaps does"
            )
        return self.albedo

    @property
    def by_colour(self) -> tuple["Medium", "Medium", "Medium"]:
        """Grey smoke as red, green and blue light see it."""
        red, green, blue = self.albedo if isinstance(self.albedo, tuple) else (self.albedo,) * 3
        return replace(self, albedo=red), replace(self, albedo=green), replace(self, albedo=blue)


def _check_channels(kind: str, channels: tuple[str, ...], image: np.ndarray) -> None:
    if image.ndim != 3 or image.shape[-1] != len(channels):
        raise ValueError(f"{kind} of channels {channels} needs an image [h, w, {len(channels)}], got {image.shape}")
    if len(set(channels)) != len(channels):
        raise ValueError(f"{kind} names a channel twice: {channels}")
    check_array(kind, image, shape=image.shape, minimum=0.0)


@dataclass(frozen=True, kw_only=True)
class GuideMap:
    """The cheap picture that the net reads. image: [h, w, c] float32 >= 0, channels by name.

    Channels are ``in_scatter`` (the sum over the surrogate lights) or one per direction (both in
    lightmap units M = pi L / E), ``transmittance`` in [0, 1] and ``depth`` (0 = empty, (0, 1] from the
    near to the far end of the volume's bounding sphere).
    depth_m: [h, w] metres along the ray to the first smoke, infinite where there is none.
    """

    channels: tuple[str, ...]
    image: Float[np.ndarray, "h w c"]
    depth_m: Float[np.ndarray, "h w"]

    def __post_init__(self) -> None:
        _check_channels("guide", self.channels, self.image)
        if self.depth_m.shape != self.image.shape[:2]:
            raise ValueError(f"guide depth_m has shape {self.depth_m.shape}, expected {self.image.shape[:2]}")

    def __getitem__(self, channel: str) -> Float[np.ndarray, "h w"]:
        return self.image[..., self.channels.index(channel)]


@dataclass(frozen=True, kw_only=True)
class SixWayLightmap:
    """Six lightmaps and alpha, with emissive where there is fire. image: [h, w, c] float32, linear.

    channels: the six `DIRECTIONS` and ``alpha`` in the order of `LIGHTMAP_CHANNELS`, then ``emissive``
    if it is known. Values as `LIGHTMAP_CHANNELS` defines them.
    """

    channels: tuple[str, ...]
    image: Float[np.ndarray, "h w c"]

    def __post_init__(self) -> None:
        if self.channels not in (LIGHTMAP_CHANNELS, LIGHTMAP_CHANNELS[:-1]):
            raise ValueError(f"a six-way lightmap holds {LIGHTMAP_CHANNELS} (emissive optional), got {self.channels}")
        _check_channels("lightmap", self.channels, self.image)

    def __getitem__(self, channel: str) -> Float[np.ndarray, "h w"]:
        return self.image[..., self.channels.index(channel)]

    @property
    def maps(self) -> Float[np.ndarray, "h w 6"]:
        """The six directional maps, in the order of `DIRECTIONS`."""
        return self.image[..., : len(DIRECTIONS)]
