"""The door to the reference: a frame of smoke and a camera in, six-way lightmaps out.

tracer = LightmapTracer(ReferenceConfig(), Medium(extinction_per_m=20.0))
lightmap = tracer.trace(frame, Camera.around(frame.grid), seed=0)
"""

import sys
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Annotated, Literal, Protocol

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sixway.core.config import Config
from sixway.core.conventions import LIGHTMAP_CHANNELS, Bounces
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.reference.lights import MOST_ANGLE_DEG
from sixway.reference.variant import Device, use_variant

Method = Literal["cached", "path", "stock"]


class ReferenceConfig(Config):
    """How the reference is traced.

    method: ``cached`` computes light once per voxel for all six maps and is made for datasets; ``path`` follows
    unbiased paths that the six lights share, and is the audit of ``cached``; ``stock`` is six runs of Mitsuba's
    volpath, some 20 times slower than ``path``, and is the audit of ``path``. Voxels above an optical depth of 0.4
    are divided by ``cached`` while memory allows; where it does not, light is some 1 % too dark at 1.
    bounces: indirect bounces, ``single`` 0, ``paper`` 1, ``multi`` unlimited.
    samples: directions per voxel and bounce (cached), paths per pixel (path: all lights at once, rounded up
    to a multiple of 16; stock: each light). Error of ``cached`` with one bounce in a jet of 64^3: 1.2 % with 8.
    source_optical_depth: of the thickest voxel of the grid that ``cached`` keeps scattered light on; below it
    those voxels are 2 or 4 times larger than the smoke's. 0 never enlarges them. At 0.3 the light's mean is
    right to 0.2 %, at 0.6 to 0.5 % (1 % with all bounces), and each doubling is some 10 times faster.
    light_angle_deg: how wide the lights are, seen from the smoke, as a disc; 0 casts hard shadows. E is the sum of
    what arrives at planes that face each point of the disc. ``cached`` and ``stock`` take 32 points of it; ``cached``
    averages transmittance and phase function over them, each by itself: 30 degrees wide, its mean may be 1 % off.
    """

    method: Method = "cached"
    bounces: Bounces = "paper"
    samples: Annotated[int, Field(ge=1, le=1 << 20)] = 8
    source_optical_depth: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3
    light_angle_deg: Annotated[float, Field(ge=0.0, le=MOST_ANGLE_DEG)] = 0.0


class _Tracer(Protocol):
    def trace_views(
        self, frame: DensityFrame, cameras: Sequence[Camera], *, seeds: Sequence[int]
    ) -> Iterator[Float[np.ndarray, "h w c"]]: ...


class LightmapTracer:
    """Traces many frames and views of one kind of smoke; kernels are compiled once and kept.

    method: the one in use, which is ``stock`` where Mitsuba runs in scalar code only. variant: Mitsuba's, which names
    the device.
    Raises ValueError for device ``cuda`` without CUDA, for an RGB albedo, and for ``cached`` with bounces ``multi`` and
    hg_g beyond 0.3 in either direction.
    """

    def __init__(self, config: ReferenceConfig, medium: Medium, *, device: Device = "auto") -> None:
        self.config = config
        self.medium = medium
        self.device = device
        self.method: Method = config.method
        self.variant = use_variant(device)
        if self.variant.startswith("scalar") and config.method != "stock":
            _say_stock()
            self.method = "stock"
        self._tracer = self._make(medium)

    def _make(self, medium: Medium) -> _Tracer:
        config = self.config
        angle = config.light_angle_deg
        # imported here: these load Dr.Jit, which must not happen before use_variant has chosen its LLVM
        match self.method:
            case "cached":
                from sixway.reference.cached import CachedTracer

                return CachedTracer(
                    bounces=config.bounces,
                    samples=config.samples,
                    medium=medium,
                    source_optical_depth=config.source_optical_depth,
                    light_angle_deg=angle,
                )
            case "path":
                from sixway.reference.path import PathTracer

                return PathTracer(bounces=config.bounces, samples=config.samples, medium=medium, light_angle_deg=angle)
            case "stock":
                from sixway.reference.stock import StockTracer

                return StockTracer(bounces=config.bounces, samples=config.samples, medium=medium, light_angle_deg=angle)

    def trace(self, frame: DensityFrame, camera: Camera, *, seed: int) -> SixWayLightmap:
        """Six maps (M = pi L / E) and alpha, as `camera` sees them. The same seed gives the same image.

        A frame with emission adds the channel ``emissive``: the radiance of its fire behind its own smoke.

        Solid obstacles hide the smoke behind them and cast no shadow; alpha counts only smoke in front of
        them. Raises ValueError for obstacles or a camera inside the volume with method ``stock``.
        """
        return next(self.trace_views(frame, [camera], seeds=[seed]))

    def trace_views(
        self, frame: DensityFrame, cameras: Sequence[Camera], *, seeds: Sequence[int]
    ) -> Iterator[SixWayLightmap]:
        """The lightmaps of several cameras that see the same frame, one after the other, each as `trace` says.

        Method ``cached`` computes once what they share: the smoke on the device, optical depths to lights that
        stand equally in the world (top and bottom of all level cameras, all six at yaws of 0, 90, 180 and 270
        degrees), and, where hg_g is 0, the light scattered from those. Shared scattered light has the random
        numbers of the first camera that asks for it, so noise is shared with it. Raises ValueError unless there
        is one seed for each camera.
        """
        if len(seeds) != len(cameras):
            raise ValueError(f"{len(cameras)} cameras need as many seeds, not {len(seeds)}")
        return self._views(frame, cameras, seeds)

    def _views(self, frame: DensityFrame, cameras: Sequence[Camera], seeds: Sequence[int]) -> Iterator[SixWayLightmap]:
        use_variant(self.device)  # another tracer may have switched it
        images = self._tracer.trace_views(frame, cameras, seeds=seeds)
        for camera in cameras:
            use_variant(self.device)  # or may have since the last view
            yield self._lightmap(next(images), frame, camera)

    def _lightmap(self, image: Float[np.ndarray, "h w c"], frame: DensityFrame, camera: Camera) -> SixWayLightmap:
        from sixway.reference.emission import with_emissive

        if self.method != "stock":  # whose alpha and fire come from one march
            image = with_emissive(image, frame, camera, self.medium)
        return SixWayLightmap(channels=LIGHTMAP_CHANNELS[: image.shape[-1]], image=image)


@cache
def _say_stock() -> None:
    print("sixway: methods 'cached' and 'path' need LLVM or CUDA; tracing with 'stock' instead", file=sys.stderr)


def trace_lightmaps(
    frame: DensityFrame,
    camera: Camera,
    medium: Medium,
    *,
    bounces: Bounces = "paper",
    samples: int = 8,
    seed: int = 0,
    method: Method = "cached",
) -> SixWayLightmap:
    """One lightmap in one call; for many, keep a `LightmapTracer`."""
    config = ReferenceConfig(method=method, bounces=bounces, samples=samples)
    return LightmapTracer(config, medium).trace(frame, camera, seed=seed)


def trace_rgb_lightmaps(
    frame: DensityFrame,
    camera: Camera,
    medium: Medium,
    *,
    bounces: Bounces = "paper",
    samples: int = 8,
    seed: int = 0,
    method: Method = "cached",
    device: Device = "auto",
) -> tuple[SixWayLightmap, SixWayLightmap, SixWayLightmap]:
    """Lightmaps as red, green and blue light show smoke whose albedo is RGB, all from the same random numbers.

    Equal albedos give equal bytes and are traced once; method ``cached`` computes optical depths once for all.
    """
    config = ReferenceConfig(method=method, bounces=bounces, samples=samples)
    colours: dict[Medium, SixWayLightmap] = {}
    smoke = None
    for grey in dict.fromkeys(medium.by_colour):
        tracer = LightmapTracer(config, grey, device=device)
        if tracer.method != "cached":
            colours[grey] = tracer.trace(frame, camera, seed=seed)
            continue
        smoke = smoke or tracer._tracer.smoke_of(frame)  # type: ignore[attr-defined]
        image = tracer._tracer.trace(frame, camera, seed=seed, smoke=smoke)  # type: ignore[attr-defined]
        colours[grey] = tracer._lightmap(image, frame, camera)
    red, green, blue = (colours[grey] for grey in medium.by_colour)
    return red, green, blue
