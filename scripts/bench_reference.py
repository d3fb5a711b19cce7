"""How much sooner `cached` is as good as six stock renders, and how many views an hour it makes.

python scripts/bench_reference.py --json bench_reference.json

A simulated jet of 128^3 scaled to peak optical depth 10. Errors, bias included, are measured against an
independent reference of method `path` in two halves A and B: the mean of (x - A)(x - B) is the squared
error of x without the reference's own noise.
"""

import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser

from sixway.core.config import load_config
from sixway.core.conventions import Bounces
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.reference.lightmaps import LightmapTracer, Method, ReferenceConfig
from sixway.reference.variant import use_variant
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

SCENARIO = Path(__file__).parents[1] / "configs/sim/jet.yaml"
PEAK_OPTICAL_DEPTH = 10.0
DEVICE = "auto"
CACHED_SAMPLES: dict[Bounces, int] = {"single": 1, "paper": 8, "multi": 4}
STOCK_SAMPLES = 16  # its pictures are averaged until they have taken as long as a cached one
LEAST_VIEWS: dict[Bounces, float] = {"single": 10000.0, "paper": 3000.0, "multi": 800.0}
LEAST_RATIO: dict[Bounces, float] = {"single": 500.0, "paper": 60.0, "multi": 60.0}


def jet(cells: int, frames: int) -> tuple[DensityFrame, Medium]:
    scenario = load_config(ScenarioConfig, SCENARIO, [f"resolution={{cells: {cells}, refinement: 2}}"])
    solver = SmokeSolver(scenario, device="cpu")
    for _ in range(frames):
        solver.advance()
    frame = solver.frame()
    thickest = max(float(frame.density.sum(axis).max()) for axis in range(3)) * frame.grid.voxel_size_m
    return frame, Medium(extinction_per_m=PEAK_OPTICAL_DEPTH / thickest)


@dataclass(frozen=True)
class Reference:
    """Two independent halves [h, w, 6] and the pixels that show smoke [h, w]."""

    first: np.ndarray
    second: np.ndarray
    smoke: np.ndarray

    @classmethod
    def traced(cls, frame: DensityFrame, camera: Camera, medium: Medium, bounces: Bounces, samples: int) -> "Reference":
        config = ReferenceConfig(method="path", bounces=bounces, samples=samples)
        tracer = LightmapTracer(config, medium, device=DEVICE)
        first, second = (tracer.trace(frame, camera, seed=seed) for seed in (1001, 1002))
        return cls(first.maps, second.maps, first["alpha"] > 0.02)

    def squared_error(self, maps: np.ndarray) -> float:
        """Mean square over smoke pixels and lights, relative to their mean squared."""
        product = ((maps - self.first) * (maps - self.second))[self.smoke].mean()
        mean = 0.5 * (self.first + self.second)[self.smoke].mean()
        return max(float(product), 0.0) / float(mean) ** 2

    def bias(self, maps: np.ndarray) -> float:
        """Largest relative difference of a light's mean."""
        mean = 0.5 * (self.first + self.second).mean((0, 1))
        return float(np.abs(maps.mean((0, 1)) / mean - 1.0).max())


def timed(tracer: LightmapTracer, frame: DensityFrame, camera: Camera, seed: int) -> tuple[float, np.ndarray]:
    start = time.perf_counter()
    maps = tracer.trace(frame, camera, seed=seed).maps
    return time.perf_counter() - start, maps


def against_stock(
    result: Measurement, frame: DensityFrame, medium: Medium, camera: Camera, bounces: Bounces, quick: bool
) -> None:
    """The two in turn, so that whatever else runs on the machine slows both."""

    def tracer(method: Method, samples: int) -> LightmapTracer:
        return LightmapTracer(ReferenceConfig(method=method, bounces=bounces, samples=samples), medium, device=DEVICE)

    reference = Reference.traced(frame, camera, medium, bounces, 256 if quick else 2048)
    cached, stock = tracer("cached", CACHED_SAMPLES[bounces]), tracer("stock", STOCK_SAMPLES)
    for warm in (cached, stock):
        warm.trace(frame, camera, seed=0)
    times: dict[str, list[float]] = {"cached": [], "stock": []}
    errors: dict[str, list[float]] = {"cached": [], "stock": []}
    for seed in range(1, result.repetitions + 1):
        for name, trace in (("cached", cached), ("stock", stock)):
            seconds, maps = timed(trace, frame, camera, seed)
            times[name].append(seconds)
            errors[name].append(reference.squared_error(maps))
            if name == "cached":
                bias = reference.bias(maps)
    seconds = {name: statistics.median(values) for name, values in times.items()}
    squared = {name: statistics.median(values) for name, values in errors.items()}
    # stock is unbiased: its squared error falls as 1 / time
    at_equal_time = squared["stock"] * seconds["stock"] / seconds["cached"]
    label = f"{bounces}, {camera.width_px}^2"
    result.add(f"{label}, cached, seconds", seconds["cached"], "s")
    result.add(f"{label}, cached, error with bias", 100.0 * squared["cached"] ** 0.5, "% of mean")
    result.add(f"{label}, cached, largest bias of a light", 100.0 * bias, "%", at_most=None if quick else 0.5)
    result.add(f"{label}, stock, {STOCK_SAMPLES} paths a light, seconds", seconds["stock"], "s")
    result.add(f"{label}, stock, error at the time of cached", 100.0 * at_equal_time**0.5, "% of mean")
    ratio = at_equal_time / max(squared["cached"], 1e-12)
    result.add(f"{label}, stock / cached, time to equal error", ratio, "x", at_least=LEAST_RATIO[bounces])


def views_per_hour(result: Measurement, frame: DensityFrame, medium: Medium, quick: bool) -> None:
    """Level cameras around a frame that share what they can, and the noise that the samples give.

    CPU time is told beside it: on a busy machine it is the steadier figure.
    """
    cases: tuple[tuple[Bounces, int], ...] = (("single", 1), ("paper", 4), ("multi", 2))
    for size in (32,) if quick else (128, 256, 512):
        for bounces, samples in cases[:2] if quick else cases:
            config = ReferenceConfig(bounces=bounces, samples=samples)
            tracer = LightmapTracer(config, medium, device=DEVICE)
            yaws = range(0, 360, 120 if quick or bounces == "multi" else 40)
            cameras = [
                Camera.around(frame.grid, yaw_deg=float(yaw), margin=0.75, width_px=size, height_px=size)
                for yaw in yaws
            ]
            other = tracer.trace(frame, cameras[0], seed=99)
            start, cpu = time.perf_counter(), time.process_time()
            pictures = [lightmap.maps for lightmap in tracer.trace_views(frame, cameras, seeds=range(len(cameras)))]
            seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - cpu
            smoke = other["alpha"] > 0.02
            first, second = pictures[0][smoke], other.maps[smoke]
            noise = 100.0 * float(np.sqrt(np.mean((first - second) ** 2) / 2.0) / first.mean())
            label = f"{bounces}, {samples} samples, {len(cameras)} yaws, {size}^2"
            least = LEAST_VIEWS[bounces] if size == 128 else None
            result.add(f"{label}, views an hour", 3600.0 * len(cameras) / seconds, "1/h", at_least=least)
            result.add(f"{label}, CPU seconds a view", cpu_seconds / len(cameras), "s")
            result.add(f"{label}, two-seed noise", noise, "% of mean", at_most=2.0 if bounces == "paper" else None)
            if bounces == "paper" and size in (32, 128):
                start = time.perf_counter()
                for number, camera in enumerate(cameras):
                    tracer.trace(frame, camera, seed=number)
                result.add(f"{label}, time alone / shared", (time.perf_counter() - start) / seconds, "x")


def main() -> int:
    options = parser(__doc__ or "").parse_args()
    if use_variant(DEVICE).startswith("scalar"):
        print("Mitsuba runs in scalar code only: nothing to measure here, skipped")
        return 0
    wp.config.log_level = wp.LOG_WARNING
    quick = options.quick
    cells, frames, size = (32, 16, 64) if quick else (64, 60, 128)
    config = {"cells": cells, "frames": frames, "peak_optical_depth": PEAK_OPTICAL_DEPTH, "quick": quick}
    result = Measurement(config, repetitions=3)
    frame, medium = jet(cells, frames)
    camera = Camera.around(frame.grid, yaw_deg=30.0, margin=0.75, width_px=size, height_px=size)
    cases: tuple[Bounces, ...] = ("single", "paper", "multi")
    for bounces in cases[:2] if quick else cases:
        against_stock(result, frame, medium, camera, bounces, quick)
    views_per_hour(result, frame, medium, quick)
    return result.finish(options.json)


if __name__ == "__main__":
    sys.exit(main())
