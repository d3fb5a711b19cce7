"""What each guide costs and how near it comes to the truth: the tables by which a guide is chosen.

python scripts/bench_guide.py --json guide.json

Error: RMSE and PSNR in sRGB, scaled so that the truth's 99.9th percentile is 1, against a fine march (single
scattering, half-voxel steps) and against the path-traced reference with one indirect bounce, at 128 x 128. A summed
guide is compared with the sum of the truth's maps. Edges: the same on a jet past a cylinder, whose outline the
reference samples sixteen times a pixel. Flicker: smoke grows by a voxel a frame; how much the guide's change differs
from the fine march's. Cost: a new frame each time, from the volume in memory to the finished picture. Processor time
is told beside the clock's: on a shared machine the clock says little.
"""

import itertools
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser
from rich.console import Console
from rich.table import Table
from scipy.ndimage import zoom

from sixway.core.color import encode_srgb
from sixway.core.config import load_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, GuideMap, Medium
from sixway.guide.config import LIGHT_SETS, GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

SCENARIOS = Path(__file__).parents[1] / "configs/sim"
MEDIUM = Medium(extinction_per_m=40.0)
SIX = {"lights": "all", "sum_lights": False}
SWEEP = {**SIX, "lighting": "sweep"}
FINE = GuideConfig(**SIX, step_voxels=0.5, jitter=False)
LITERAL, DEFAULT_SWEEP = "march, 10 voxels", "sweep"
VARIANTS = {
    "paper: march, front_tb summed": GuideConfig(),
    **{f"march, {name} summed": GuideConfig(lights=name) for name in LIGHT_SETS if name != "front_tb"},
    **{f"sweep, {name} summed": GuideConfig(lights=name, lighting="sweep") for name in LIGHT_SETS},
    "march, 6 lights": GuideConfig(**SIX),
    "march, 6 lights, 10 voxels": GuideConfig(**SIX, step_voxels=10.0),
    "march, 6 lights, mip 2": GuideConfig(**SIX, mip=2),
    "march, 6 lights, mip 4": GuideConfig(**SIX, mip=4),
    **{f"sweep, 6 lights, grid {n}": GuideConfig(**SWEEP, light_grid=n) for n in (16, 32, 64, 96)},
    "sweep, 6 lights, grid 64, 24 samples": GuideConfig(**SWEEP, light_samples=24),
    "sweep, 6 lights, grid 64, 4 rays on edges": GuideConfig(**SWEEP, pixel_samples=4),
    **{
        f"sweep, 6 lights, grid {n}, scattered once": GuideConfig(**SWEEP, light_grid=n, scatter_iterations=1)
        for n in (32, 64, 96)
    },
    "rich: sweep, 6 lights, grid 96, 24 samples, scattered once, 16 rays on edges": GuideConfig(
        **SWEEP, light_grid=96, light_samples=24, scatter_iterations=1, pixel_samples=16
    ),
}
COSTS = {LITERAL: {"sum_lights": False, "step_voxels": 10.0}, DEFAULT_SWEEP: {"sum_lights": False, "lighting": "sweep"}}
LIGHTS = ("front", "top", "bottom", "right", "left", "back")
TARGETS_MS = {  # on two idle cores through 128^3
    (LITERAL, 3, 256): 45.0,
    (LITERAL, 3, 512): 140.0,
    (DEFAULT_SWEEP, 6, 256): 30.0,
    (DEFAULT_SWEEP, 6, 512): 100.0,
}


def main() -> int:
    options = parser("Cost and error of every guide.")
    options.add_argument("--frames", type=int, default=50, help="frames that the jet runs before (default: 50)")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    repetitions = 3 if chosen.quick else 5
    load = os.getloadavg()[0]
    result = Measurement({"scenario": "jet", "frames": chosen.frames, "load_before": load}, repetitions)
    frame = simulated("jet", 32 if chosen.quick else 64, chosen.frames)
    edge = frame.density.shape[0]
    compare(result, frame, f"{edge}^3")
    flicker(result, frame if chosen.quick else enlarged(frame, 0.5))
    if not chosen.quick:
        edges(result, simulated("jet_cylinder", 32, chosen.frames))
    volumes = [frame] if chosen.quick else [enlarged(frame, 0.5), frame, enlarged(frame, 2.0)]
    time_sizes(result, volumes, (128, 256) if chosen.quick else (128, 256, 512), repetitions)
    time_variants(result, frame, repetitions)
    time_nine_yaws(result, frame, repetitions)
    return result.finish(chosen.json)


def simulated(scenario: str, cells: int, frames: int) -> DensityFrame:
    overrides = (f"resolution={{cells: {cells}, refinement: 2}}",)
    solver = SmokeSolver(load_config(ScenarioConfig, SCENARIOS / f"{scenario}.yaml", overrides), device="cpu")
    for _ in range(frames):
        solver.advance()
    return solver.frame()


def enlarged(frame: DensityFrame, factor: float) -> DensityFrame:
    """The same smoke in other voxels: costs depend on how much of the box it fills."""
    density = np.maximum(zoom(frame.density, factor, order=1), 0.0).astype(np.float32)
    return DensityFrame(density=density, grid=Grid.centred(density.shape))


def camera_of(frame: DensityFrame, size: int, yaw_deg: float = 30.0) -> Camera:
    return Camera.around(frame.grid, yaw_deg=yaw_deg, pitch_deg=10.0, margin=0.8, width_px=size, height_px=size)


def guide_of(config: GuideConfig, frame: DensityFrame, camera: Camera) -> GuideMap:
    return GuideMarcher(config, MEDIUM, device="cpu", threads=2).march(frame, camera, seed=1)


def compare(result: Measurement, frame: DensityFrame, volume: str) -> None:
    camera = camera_of(frame, 128)
    tracer = LightmapTracer(ReferenceConfig(samples=8), MEDIUM, device="cpu")
    truths = {
        "fine march": guide_of(FINE, frame, camera).image[..., :6],
        "reference": tracer.trace(frame, camera, seed=0).maps,
    }
    result.add(f"{volume}, the fine march to the reference", psnr(*truths.values())[0], "dB")
    for name, config in VARIANTS.items():
        guide = guide_of(config, frame, camera)
        for truth_name, truth in truths.items():
            decibels, rmse = psnr(*comparable(guide, config, truth))
            result.add(f"{volume}, {name}, to the {truth_name}", decibels, "dB")
            result.add(f"{volume}, {name}, to the {truth_name}", rmse, "RMSE in sRGB")


def comparable(guide: GuideMap, config: GuideConfig, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The guide's light channels and what they should be."""
    expected = truth[..., [DIRECTIONS.index(name) for name in config.light_names]]
    if config.sum_lights:
        expected = expected.sum(axis=-1, keepdims=True)
    return guide.image[..., : expected.shape[-1]], expected


def psnr(maps: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """PSNR [dB] and RMSE of maps in sRGB, brightness scaled to the truth's 99.9th percentile."""
    scale = 1.0 / float(np.percentile(truth, 99.9))
    mse = float(np.mean((encode_srgb(maps * scale) - encode_srgb(truth * scale)) ** 2))
    return -10.0 * float(np.log10(mse)), mse**0.5


def edges(result: Measurement, frame: DensityFrame) -> None:
    """What more rays on edges gain where an obstacle stands in the picture."""
    tracer = LightmapTracer(ReferenceConfig(samples=16), MEDIUM, device="cpu")
    for size in (64, 128):
        camera = camera_of(frame, size)
        truth = tracer.trace(frame, camera, seed=0).maps
        for rays in (1, 4, 16):
            config = GuideConfig(**SWEEP, scatter_iterations=1, pixel_samples=rays)
            label = f"cylinder at {size}^2, sweep scattered once, {rays} rays a pixel on edges, to the reference"
            result.add(label, psnr(guide_of(config, frame, camera).image[..., :6], truth)[0], "dB")


def flicker(result: Measurement, frame: DensityFrame) -> None:
    camera = camera_of(frame, 96)
    height = np.arange(frame.density.shape[1])[None, :, None]
    grown = [
        replace(frame, density=np.where(height < top, frame.density, 0.0).astype(np.float32))
        for top in range(frame.density.shape[1] // 3, frame.density.shape[1] // 3 + 8)
    ]

    def lit(config: GuideConfig) -> np.ndarray:
        return np.array([guide_of(config, each, camera).image[..., :6] for each in grown])

    truth = lit(FINE)
    result.add("change a frame of the fine march", rms(np.diff(truth, axis=0)), "RMS")
    for name, config in {
        "march, 6 lights": GuideConfig(**SIX, jitter=False),
        "sweep, grid 64": GuideConfig(**SWEEP, jitter=False),
        "sweep, grid 32": GuideConfig(**SWEEP, jitter=False, light_grid=32),
    }.items():
        guides = lit(config)
        result.add(f"error of {name}", rms(guides - truth), "RMS")
        result.add(f"flicker of {name}", rms(np.diff(guides - truth, axis=0)), "RMS")


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(difference**2)))


def time_sizes(result: Measurement, volumes: list[DensityFrame], sizes: tuple[int, ...], repetitions: int) -> None:
    """Cost against the edge of the volume, the edge of the picture and the number of lights, on two threads."""
    counts = (1, 2, 3, 6) if len(volumes) > 1 else (3, 6)
    table = Table("ms, 2 threads", *(f"{size}^2, {lights} lights" for size in sizes for lights in counts))
    for name, frame in itertools.product(COSTS, volumes):
        edge, cells = frame.density.shape[0], []
        for size, lights in itertools.product(sizes, counts):
            config = GuideConfig.model_validate({**COSTS[name], "lights": LIGHTS[:lights]})
            target = TARGETS_MS.get((name, lights, size)) if edge == 128 else None
            label = f"{edge}^3 at {size}^2, {name}, {lights} lights"
            clock = time_one(result, label, config, frame, camera_of(frame, size), 2, repetitions, target)
            cells.append(f"{clock:.1f}")
        table.add_row(f"{name}, {edge}^3", *cells)
    Console(width=None if sys.stdout.isatty() else 180).print(table)


def time_variants(result: Measurement, frame: DensityFrame, repetitions: int) -> None:
    burning = replace(frame, emission=frame.density)
    variants = VARIANTS | {"sweep, 6 lights, with emission": GuideConfig(**SWEEP, emission=True)}
    for name, config in variants.items():
        if "summed" in name and "paper" not in name:
            continue  # costs what its lights cost one by one
        label = f"{frame.density.shape[0]}^3 at 256^2, {name}, 1 thread"
        time_one(result, label, config, burning, camera_of(frame, 256), 1, repetitions, None)


def time_nine_yaws(result: Measurement, frame: DensityFrame, repetitions: int) -> None:
    """Nine views of a frame: what they share, and what all of them cost alone."""
    cameras = [camera_of(frame, 256, yaw_deg=40.0 * n) for n in range(9)]
    marcher = GuideMarcher(GuideConfig(**SWEEP, scatter_iterations=1), MEDIUM, device="cpu", threads=2)

    def shared() -> None:
        list(marcher.march_views(replace(frame), cameras, seeds=range(9)))

    def alone() -> None:
        for seed, camera in enumerate(cameras):
            marcher.march(replace(frame), camera, seed=seed)

    for name, work in {"together": shared, "one by one": alone}.items():
        clock, processor = median_ms(work, repetitions)
        result.add(f"nine yaws at 256^2, sweep scattered once, {name}", clock, "ms")
        result.add(f"nine yaws at 256^2, sweep scattered once, {name}", processor, "ms of processor time")


def time_one(
    result: Measurement,
    label: str,
    config: GuideConfig,
    frame: DensityFrame,
    camera: Camera,
    threads: int,
    repetitions: int,
    target_ms: float | None,
) -> float:
    marcher = GuideMarcher(config, MEDIUM, device="cpu", threads=threads)
    clock, processor = median_ms(lambda: marcher.march(replace(frame), camera, seed=1), repetitions)
    result.add(label, clock, "ms", at_most=target_ms)
    result.add(label, processor, "ms of processor time")
    return clock


def median_ms(work: Callable[[], object], repetitions: int) -> tuple[float, float]:
    """Medians by the clock and by the processor, once the threads have found their cores."""
    warm = time.perf_counter() + 0.1
    while time.perf_counter() < warm:
        work()
    clock, processor = [], []
    for _ in range(repetitions):
        started, spent = time.perf_counter(), time.process_time()
        work()
        clock.append(1e3 * (time.perf_counter() - started))
        processor.append(1e3 * (time.process_time() - spent))
    return statistics.median(clock), statistics.median(processor)


if __name__ == "__main__":
    sys.exit(main())
