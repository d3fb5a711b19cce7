"""What a dataset will cost, from a probe of two frames made on the spot."""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sixway.core.exr import write_exr
from sixway.core.records import DensityFrame
from sixway.generation.stages import Generation
from sixway.generation.traced import HalvedTracer
from sixway.guide.march import GuideMarcher
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver
from sixway.volumes.npz import write_npz

_LONGEST_PROBE_S = 20.0


@dataclass(frozen=True)
class Cost:
    """Time and disk of one stage."""

    stage: str
    units: int
    seconds_each: float
    bytes_each: float

    @property
    def seconds(self) -> float:
        return self.units * self.seconds_each

    @property
    def bytes(self) -> float:
        return self.units * self.bytes_each


def estimate(job: Generation) -> list[Cost]:
    """Probe two frames from the middle of the first simulation through every stage, kernels compiled beforehand.

    The way to the middle is cut short after some seconds; young smoke then makes the estimate too low,
    which is said on standard output.
    """
    plan, device = job.plan, job.device
    config, simulation = plan.config, plan.simulations[0]
    medium, view = config.medium.medium, simulation.views[0]
    frames_simulated = sum(s.scenario.warmup_frames + max(s.frames) + 1 for s in plan.simulations)
    frames_kept = sum(len(s.frames) for s in plan.simulations)
    views = {
        split: sum(len(s.frames) * len(s.views) for s in plan.simulations if (s.split == "test") == split)
        for split in (False, True)
    }
    seconds, frames = _probe(simulation.scenario, device=device)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_npz(folder / "d.npz", frames[-1])
        costs = [
            Cost("simulate", frames_simulated, seconds, 0.0),
            Cost("density files", frames_kept, 0.0, (folder / "d.npz").stat().st_size),
        ]
        for guide_name, guide in config.guides.items():
            marcher = GuideMarcher(guide, medium, device=device)
            marcher.march(frames[0], view.camera, seed=0)
            start = time.perf_counter()
            image = [marcher.march(frame, view.camera, seed=0) for frame in frames[1:]][-1]
            each = (time.perf_counter() - start) / len(frames[1:])
            write_exr(folder / "g.exr", image.image, image.channels)
            size = (folder / "g.exr").stat().st_size
            costs.append(Cost(f"guide {guide_name}", sum(views.values()), each, size))
        tracer = HalvedTracer(config.reference, medium, device=job.tracer_device)
        cameras = [view.camera for view in simulation.views]
        list(tracer.trace_views(frames[0], cameras, seed=0))
        start = time.perf_counter()
        traced = [one for frame in frames[1:] for one in tracer.trace_views(frame, cameras, seed=0)]
        each = (time.perf_counter() - start) / len(traced)
        lightmap = traced[-1].lightmap
        write_exr(folder / "t.exr", lightmap.image, lightmap.channels)
        size = (folder / "t.exr").stat().st_size
        costs.append(Cost("references", views[False], each, size))
        if views[True]:
            costs.append(Cost("test references", views[True], each * config.test_samples_factor, size))
        row = 2 * view.camera.width_px * view.camera.height_px
        channels = lightmap.image.shape[-1] + 2 + sum(len(guide.channels) for guide in config.guides.values())
        costs.append(Cost("packed arrays", sum(views.values()), 0.0, row * channels))
    return costs


def _probe(scenario: ScenarioConfig, *, device: str) -> tuple[float, list[DensityFrame]]:
    """Seconds a simulated frame, and three frames around the middle of the sequence."""
    solver = SmokeSolver(scenario, device=device)
    solver.advance()  # compiles
    middle, done = scenario.warmup_frames + scenario.frames // 2, 0
    start = time.perf_counter()
    while done < middle and time.perf_counter() - start < _LONGEST_PROBE_S:
        solver.advance()
        done += 1
    if done < middle:
        print(f"the probe stopped at frame {done} of {middle}: smoke is still young, references will cost more")
    frames = []
    for _ in range(3):
        solver.advance()
        frames.append(solver.frame())
    return (time.perf_counter() - start) / (done + 3), frames


def print_costs(costs: list[Cost], *, workers: int) -> None:
    """A table of the estimate on standard output."""
    table = Table("stage", "frames", "s each", "minutes", "MB", title="Estimated cost (one process)")
    for cost in costs:
        table.add_row(
            cost.stage,
            str(cost.units),
            f"{cost.seconds_each:.3f}",
            f"{cost.seconds / 60:.1f}",
            f"{cost.bytes / 1e6:.1f}",
        )
    total_s, total_bytes = sum(cost.seconds for cost in costs), sum(cost.bytes for cost in costs)
    table.add_row("total", "", "", f"{total_s / 60:.1f}", f"{total_bytes / 1e6:.1f}")
    Console().print(table)
    if workers > 1:
        print(f"simulate and guides run in {workers} processes, so their share shrinks")
