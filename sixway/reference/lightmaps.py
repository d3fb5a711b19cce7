"""The door to the reference: a frame of smoke and a camera in, six-way lightmaps out.

tracer = LightmapTracer(ReferenceConfig(), Medium(extinction_per_m=20.0))
lightmap = tracer.trace(frame, Camera.around(frame.grid), seed=0)
"""

import sys
from functools import cache
from typing import Annotated, Literal, Protocol

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sixway.core.config import Config
from sixway.core.conventions import LIGHTMAP_CHANNELS, Bounces
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.reference.variant import Device, use_variant

Method = Literal["cached", "path", "stock"]


class ReferenceConfig(Config):
    """How the reference is traced.

    method: ``cached`` computes light once per voxel for all six maps and is made for datasets; ``path`` follows
    unbiased paths that the six lights share, and is the audit of ``cached``; ``stock`` is six runs of Mitsuba's
    volpath, some 20 times slower than ``path``, and is the audit of ``path``. The grid makes ``cached`` darker
    where its voxels are thick: 0.1 % at a peak of 0.3 optical depths per voxel, 1.3 % at 1.
    bounces: indirect bounces, ``single`` 0, ``paper`` 1, ``multi`` unlimited.
    samples: directions per voxel and bounce (cached), paths per pixel (path: all lights at once, rounded up
    to a multiple of 16; stock: each light). Error of ``cached`` with one bounce in a jet of 64^3: 1.2 % with 8.
    source_optical_depth: of the thickest voxel of the grid that ``cached`` keeps scattered light on; below it
    those voxels are 2 or 4 times larger than the smoke's. 0 never enlarges them. At 0.3 the light's mean is
    right to 0.2 %, at 0.6 to 0.5 % (1 % with all bounces), and each doubling is some 10 times faster.
    """

    method: Method = "cached"
    bounces: Bounces = "paper"
    samples: Annotated[int, Field(ge=1, le=1 << 20)] = 8
    source_optical_depth: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3


class _Tracer(Protocol):
    def trace(self, frame: DensityFrame, camera: Camera, *, seed: int) -> Float[np.ndarray, "h w c"]: ...


class LightmapTracer:
    """Traces many frames and views of one kind of smoke; kernels are compiled once and kept.

    method: the one in use, which is ``stock`` where Mitsuba runs in scalar code only.
    Raises ValueError for device ``cuda`` without CUDA, and for ``cached`` with bounces ``multi`` and hg_g != 0.
    """

    def __init__(self, config: ReferenceConfig, medium: Medium, *, device: Device = "auto") -> None:
        self.config = config
        self.device = device
        self.method: Method = config.method
        if use_variant(device).startswith("scalar") and config.method != "stock":
            _say_stock()
            self.method = "stock"
        self._tracer = self._make(medium)

    def _make(self, medium: Medium) -> _Tracer:
        # imported here: these load Dr.Jit, which must not happen before use_variant has chosen its LLVM
        match self.method:
            case "cached":
                from sixway.reference.cached import CachedTracer

                return CachedTracer(
                    bounces=self.config.bounces,
                    samples=self.config.samples,
                    medium=medium,
                    source_optical_depth=self.config.source_optical_depth,
                )
            case "path":
                from sixway.reference.path import PathTracer

                return PathTracer(bounces=self.config.bounces, samples=self.config.samples, medium=medium)
            case "stock":
                from sixway.reference.stock import StockTracer

                return StockTracer(bounces=self.config.bounces, samples=self.config.samples, medium=medium)

    def trace(self, frame: DensityFrame, camera: Camera, *, seed: int) -> SixWayLightmap:
        """Six maps (M = pi L / E) and alpha, as `camera` sees them. The same seed gives the same image.

        A frame with emission adds the channel ``emissive``: the radiance of its fire behind its own smoke.

        Solid obstacles hide the smoke behind them and cast no shadow; alpha counts only smoke in front of
        them. Raises ValueError for obstacles or a camera inside the volume with method ``stock``.
        """
        use_variant(self.device)  # another tracer may have switched it
        image = self._tracer.trace(frame, camera, seed=seed)
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
