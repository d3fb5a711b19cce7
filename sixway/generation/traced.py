"""A reference that knows its noise: two traces with half the samples each, their mean, and how they differ.

The mean is as good as one trace with all samples. Of two independent halves a, b the mean has the variance
Var(a) / 2 = E[(a - b)^2] / 4, so half their difference tells its noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig

_SECOND_HALF = 0x5EED
_PEAK_PERCENTILE = 99.9


@dataclass(frozen=True, kw_only=True)
class Traced:
    """A reference. noise_rmse: of its six maps over the whole picture, linear; alpha and emissive have none.

    None where it is not known. noise_psnr_db: the same against the picture's own 99.9th percentile; None where nothing
    is lit or noisy besides.
    """

    lightmap: SixWayLightmap
    noise_rmse: float | None
    noise_psnr_db: float | None


class HalvedTracer:
    """Traces like `LightmapTracer` with at least as many samples, rounded up to an even number.

    halved: False traces once and tells no noise.
    """

    def __init__(
        self, config: ReferenceConfig, medium: Medium, *, device: Literal["cpu", "cuda"], halved: bool = True
    ) -> None:
        half = config.model_copy(update={"samples": (config.samples + 1) // 2})
        self._halved = halved
        self._tracer = LightmapTracer(half if halved else config, medium, device=device)
        self.method = self._tracer.method
        self.depends_on_company = self.method == "cached"
        """Whether the views traced together decide the last bits, by which of them the shared light is made."""
        self._is_random = not (self.method == "cached" and config.bounces == "single")

    def trace_views(self, frame: DensityFrame, cameras: Sequence[Camera], *, seed: int) -> Iterator[Traced]:
        """One reference for each camera; all have the random numbers of `seed`, so that they can share light."""
        seeds = [seed] * len(cameras)
        first = self._tracer.trace_views(frame, cameras, seeds=seeds)
        if not self._halved:
            yield from (Traced(lightmap=lightmap, noise_rmse=None, noise_psnr_db=None) for lightmap in first)
            return
        if not self._is_random:
            yield from (Traced(lightmap=lightmap, noise_rmse=0.0, noise_psnr_db=None) for lightmap in first)
            return
        second = self._tracer.trace_views(frame, cameras, seeds=[seed ^ _SECOND_HALF] * len(cameras))
        for a, b in zip(first, second, strict=True):
            mean = SixWayLightmap(channels=a.channels, image=0.5 * (a.image + b.image))
            rmse = 0.5 * float(np.sqrt(np.mean((a.maps - b.maps) ** 2, dtype=np.float64)))
            peak = float(np.percentile(mean.maps, _PEAK_PERCENTILE))
            known = rmse > 0.0 and peak > 0.0
            psnr = 20.0 * float(np.log10(peak / rmse)) if known else None
            yield Traced(lightmap=mean, noise_rmse=rmse, noise_psnr_db=psnr)
