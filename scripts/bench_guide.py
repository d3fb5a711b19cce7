"""What each guide costs and how near it comes to the truth: the table by which a guide is chosen.

python scripts/bench_guide.py --json guide.json

Quality: RMSE and PSNR in sRGB, scaled so that the truth's 99.9th percentile is 1, against a fine march (single
scattering, half-voxel steps) and against the path-traced reference with one indirect bounce, at 128 x 128. A summed
guide is compared with the sum of the truth's maps. Cost: a new frame each time, from the volume in memory to the
finished picture. Processor time is told beside the clock's: on a shared machine the clock says little.
"""

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

from sixway.core.color import encode_srgb
from sixway.core.config import load_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, GuideMap, Medium
from sixway.guide.config import GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

SCENARIO = Path(__file__).parents[1] / "configs/sim/jet_tiny.yaml"
MEDIUM = Medium(extinction_per_m=40.0)
SIX = {"lights": DIRECTIONS, "sum_lights": False}
FINE = GuideConfig(**SIX, step_voxels=0.5, jitter=False)
PAPER_STEPS = "march, 3 lights, 10 voxels"
DEFAULT_SWEEP = "sweep, 6 lights, grid 64, 12 samples"
VARIANTS = {
    "paper: march, 3 lights summed": GuideConfig(),
    PAPER_STEPS: GuideConfig(sum_lights=False, step_voxels=10.0),
    "march, 6 lights": GuideConfig(**SIX),
    "march, 6 lights, mip 2": GuideConfig(**SIX, mip=2),
    "march, 6 lights, mip 4": GuideConfig(**SIX, mip=4),
    **{
        f"sweep, 6 lights, grid {grid}, {samples} samples": GuideConfig(
            **SIX, lighting="sweep", light_grid=grid, light_samples=samples
        )
        for grid in (16, 32, 64, 96)
        for samples in (12, 24)
    },
    **{
        f"sweep, 6 lights, grid {grid}, 12 samples, scattered once": GuideConfig(
            **SIX, lighting="sweep", light_grid=grid, light_samples=12, scatter_iterations=1
        )
        for grid in (32, 64, 96)
    },
}
TARGETS_MS = {  # on two idle cores through 128^3
    (DEFAULT_SWEEP, 256): 30.0,
    (DEFAULT_SWEEP, 512): 100.0,
    (PAPER_STEPS, 256): 45.0,
    (PAPER_STEPS, 512): 140.0,
}


def main() -> int:
    options = parser("Cost and quality of every guide.")
    options.add_argument("--frames", type=int, default=50, help="frames that the jet runs before (default: 50)")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    repetitions = 3 if chosen.quick else 5
    load = os.getloadavg()[0]
    result = Measurement({"scenario": SCENARIO.name, "frames": chosen.frames, "load_before": load}, repetitions)
    for cells in (32,) if chosen.quick else (32, 64):
        frame = jet(cells, chosen.frames)
        edge = frame.density.shape[0]
        compare(result, frame, f"{edge}^3")
        small_volume = not chosen.quick and cells == 32
        for size in (128, 256) if chosen.quick else (256,) if small_volume else (128, 256, 512):
            time_all(result, frame, f"{edge}^3", size, repetitions)
    return result.finish(chosen.json)


def jet(cells: int, frames: int) -> DensityFrame:
    scenario = load_config(ScenarioConfig, SCENARIO, (f"cells_xyz=[{cells}, {cells}, {cells}]",))
    solver = SmokeSolver(scenario, device="cpu")
    for _ in range(frames):
        solver.advance()
    return solver.frame()


def camera_of(frame: DensityFrame, size: int) -> Camera:
    return Camera.around(frame.grid, yaw_deg=30.0, pitch_deg=10.0, margin=0.8, width_px=size, height_px=size)


def compare(result: Measurement, frame: DensityFrame, volume: str) -> None:
    camera = camera_of(frame, 128)
    fine = GuideMarcher(FINE, MEDIUM, device="cpu", threads=2).march(frame, camera, seed=0).image[..., :6]
    tracer = LightmapTracer(ReferenceConfig(samples=8), MEDIUM, device="cpu")
    truths = {"fine march": fine, "reference": tracer.trace(frame, camera, seed=0).maps}
    result.add(f"{volume}, the fine march to the reference", psnr(fine, truths["reference"])[0], "dB")
    for name, config in VARIANTS.items():
        guide = GuideMarcher(config, MEDIUM, device="cpu", threads=2).march(frame, camera, seed=1)
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


def time_all(result: Measurement, frame: DensityFrame, volume: str, size: int, repetitions: int) -> None:
    camera = camera_of(frame, size)
    for name, config in VARIANTS.items():
        for threads in (1, 2):
            marcher = GuideMarcher(config, MEDIUM, device="cpu", threads=threads)
            clock, processor = median_ms(
                lambda marcher=marcher: marcher.march(replace(frame), camera, seed=1), repetitions
            )
            target = TARGETS_MS.get((name, size)) if threads == 2 and volume == "128^3" else None
            label = f"{volume} at {size}^2, {name}, {threads} thread{'s'[: threads - 1]}"
            result.add(label, clock, "ms", at_most=target)
            result.add(label, processor, "ms of processor time")


def median_ms(work: Callable[[], object], repetitions: int) -> tuple[float, float]:
    """Medians by the clock and by the processor, once the threads have found their cores."""
    warm = time.perf_counter() + 0.2
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
