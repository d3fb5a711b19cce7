"""What a dataset will cost, from a probe of two frames made on the spot."""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sixway.core.exr import write_exr
from sixway.core.records import DensityFrame
from sixway.generation import stages
from sixway.generation.cameras import DatasetView
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
    medium, probed = config.medium.medium, simulation.views
    frames_simulated = sum(s.scenario.warmup_frames + max(s.frames) + 1 for s in plan.simulations)
    frames_kept = sum(len(s.frames) for s in plan.simulations)
    # views differ in size: a view costs what its pixels cost
    probed_px = sum(_pixels(view) for view in probed)
    views, px = ({True: 0, False: 0} for _ in range(2))
    for s in plan.simulations:
        views[s.split != "train"] += len(s.frames) * len(s.views)
        px[s.split != "train"] += len(s.frames) * sum(_pixels(view) for view in s.views)
    all_views, all_px = sum(views.values()), sum(px.values())
    seconds, frames = _probe(simulation.scenario, job)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_npz(folder / "d.npz", frames[-1], half=True)
        costs = [
            Cost("simulate", frames_simulated, seconds, 0.0),
            Cost("density files", frames_kept, 0.0, (folder / "d.npz").stat().st_size),
        ]
        for guide_name, guide in config.guides.items():
            marcher = GuideMarcher(guide, medium, device=device)
            marcher.march(frames[0], probed[0].camera, seed=0)
            start = time.perf_counter()
            images = [marcher.march(view.seen(frames[-1]), view.camera, seed=0) for view in probed]
            each = (time.perf_counter() - start) / probed_px * all_px / all_views
            for number, image in enumerate(images):
                write_exr(folder / f"{guide_name}_{number}.exr", image.image, image.channels)
            size = sum(path.stat().st_size for path in folder.glob(f"{guide_name}_*.exr")) / probed_px
            costs.append(Cost(f"guide {guide_name}", all_views, each, size * all_px / all_views))
        halved = plan.tells_noise(simulation)
        tracer = HalvedTracer(config.reference, medium, device=job.tracer_device, halved=halved)
        list(tracer.trace_views(frames[0], [probed[0].camera], seed=0))
        start = time.perf_counter()
        traced = [
            one
            for group in stages.sharing(probed)
            for one in tracer.trace_views(group[0].seen(frames[-1]), [view.camera for view in group], seed=0)
        ]
        second_per_px = (time.perf_counter() - start) / probed_px
        for number, one in enumerate(traced):
            write_exr(folder / f"target_{number}.exr", one.lightmap.image, one.lightmap.channels)
        bytes_per_px = sum(path.stat().st_size for path in folder.glob("target_*.exr")) / probed_px
        for scored, title in ((False, "references"), (True, "val and test references")):
            if views[scored]:
                factor = config.test_samples_factor if scored else 1
                mean_px = px[scored] / views[scored]
                costs.append(Cost(title, views[scored], second_per_px * mean_px * factor, bytes_per_px * mean_px))
        channels = traced[-1].lightmap.image.shape[-1] + sum(len(guide.channels) for guide in config.guides.values())
        costs.append(Cost("packed arrays", all_views, 0.0, 2.0 * channels * all_px / all_views))
    return costs


def _pixels(view: DatasetView) -> int:
    return view.camera.width_px * view.camera.height_px


def _probe(scenario: ScenarioConfig, job: Generation) -> tuple[float, list[DensityFrame]]:
    """Seconds a simulated frame, and three frames around the middle of the sequence."""
    solver = SmokeSolver(scenario, device=job.device, make_flow=job.make_flow)
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
