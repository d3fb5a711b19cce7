"""The stages of generation. Each makes the frames that are missing and yields once for each frame made."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.exr import write_exr
from sixway.core.records import DensityFrame
from sixway.core.store import content_hash, provenance
from sixway.generation.cameras import DatasetView
from sixway.generation.jobs import FrameStore, Shard, run_shards
from sixway.generation.plan import Folder, Plan, PlannedSimulation
from sixway.generation.traced import HalvedTracer
from sixway.guide.march import GuideMarcher
from sixway.guide.motion import project_motion
from sixway.sim.flow.flow import Flow, MakeFlow
from sixway.sim.solver import SmokeSolver
from sixway.volumes.npz import read_npz, write_npz

TARGET_CHANNELS = LIGHTMAP_CHANNELS[:-1]
"""Of every reference; those of a frame that could burn hold emissive besides, as their record tells."""

FLOW_CHANNELS = ("flow_right", "flow_down")


@dataclass(frozen=True)
class Generation:
    """Where a dataset is made, by which plan, on which device (``cpu``, ``cuda``). make_flow: see `SmokeSolver`."""

    plan: Plan
    out: Path
    device: str = "cpu"
    make_flow: MakeFlow = Flow
    _stores: dict[str, FrameStore] = field(default_factory=dict, compare=False, repr=False)

    @property
    def tracer_device(self) -> Literal["cpu", "cuda"]:
        """Mitsuba knows one CUDA device; Warp tells them apart."""
        return "cuda" if self.device.startswith("cuda") else "cpu"

    def store(self, folder: Folder) -> FrameStore:
        """The same object whenever it is asked for, so that a folder's record is read once."""
        return self._stores.setdefault(folder.path, FrameStore(self.out, folder))

    def density_path(self, simulation: PlannedSimulation, frame: int) -> Path:
        return self.store(self.plan.density(simulation)).frame_path(frame, ".npz")

    def read_density(self, simulation: PlannedSimulation, frame: int) -> DensityFrame:
        path = self.density_path(simulation, frame)
        if not path.is_file():
            raise FileNotFoundError(f"{path}: this density frame is missing; run the simulate stage first")
        return read_npz(path)


def simulate(job: Generation, *, workers: int = 1) -> None:
    """Scenario -> density frames. Raises RuntimeError if a flow blows up."""
    _run(job, "simulate", simulate_shard, _density_stores(job), workers)


def march_guides(job: Generation, *, workers: int = 1) -> None:
    """Density -> one guide a variant, and the motion of the smoke in the image."""
    _run(job, "march guides", march_shard, _guide_stores(job), workers)


def trace_references(job: Generation) -> None:
    """Density -> six-way reference lightmaps. Mitsuba uses every core by itself, so there is one process."""
    _run(job, "trace references", trace_shard, _target_stores(job), 1)


def simulate_shard(job: Generation, shard: Shard) -> Iterator[None]:
    """A simulation is run again from its start if frames are missing: the same bytes come out."""
    for simulation in shard.of(list(job.plan.simulations)):
        store = job.store(job.plan.density(simulation))
        missing = {f for f in simulation.frames if not store.holds(store.frame_path(f, ".npz"))}
        if not missing:
            continue
        solver = SmokeSolver(simulation.scenario, device=job.device, make_flow=job.make_flow)
        for number, frame in enumerate(solver.frames()):
            if number in missing:
                path = store.frame_path(number, ".npz")
                write_npz(path, frame, half=True)
                store.record(path, frame=number, seed=simulation.scenario.seed, device=job.device)
                yield
            if number >= max(missing):
                break


def march_shard(job: Generation, shard: Shard) -> Iterator[None]:
    config, medium = job.plan.config, job.plan.config.medium.medium
    marchers = {name: GuideMarcher(guide, medium, device=job.device) for name, guide in config.guides.items()}
    for simulation, number in shard.of(_frames(job.plan)):
        frame: DensityFrame | None = None
        frame_s = simulation.scenario.frame_s
        for view in simulation.views:
            seen: DensityFrame | None = None
            seed = job.plan.seed(simulation, view, number)
            facts = {"frame": number, "seed": seed}
            for name, marcher in marchers.items():
                store = job.store(job.plan.guide(name, simulation, view))
                path = store.frame_path(number, ".exr")
                if not store.holds(path):
                    frame = frame or job.read_density(simulation, number)
                    seen = seen or view.seen(frame)
                    guide = marcher.march(seen, view.camera, seed=seed)
                    write_exr(path, guide.image, guide.channels, _attributes(job, simulation, view, facts))
                    store.record(path, **facts, device=job.device)
                    yield
            store = job.store(job.plan.flow(simulation, view))
            path = store.frame_path(number, ".exr")
            if not store.holds(path):
                frame = frame or job.read_density(simulation, number)
                seen = seen or view.seen(frame)
                flow = project_motion(seen, view.camera, medium, frame_s=frame_s, device=job.device)
                write_exr(path, flow, FLOW_CHANNELS, _attributes(job, simulation, view, facts))
                store.record(path, **facts, device=job.device)
                yield


def trace_shard(job: Generation, shard: Shard) -> Iterator[None]:
    """The views of a frame are traced together, because they share light."""
    medium = job.plan.config.medium.medium
    tracers: dict[str, HalvedTracer] = {}
    for simulation, number in shard.of(_frames(job.plan)):
        reference = job.plan.reference(simulation)
        halved = job.plan.tells_noise(simulation)
        key = content_hash([halved, reference.identity()])
        if key not in tracers:
            tracers[key] = HalvedTracer(reference, medium, device=job.tracer_device, halved=halved)
        frame: DensityFrame | None = None
        for views in sharing(simulation.views):
            stores = {view.name: job.store(job.plan.target(simulation, view)) for view in views}
            name = f"frame_{number:04d}.exr"
            missing = [view for view in views if not stores[view.name].holds(stores[view.name].path / name)]
            if not missing:
                continue
            frame = frame or job.read_density(simulation, number)
            # what was interrupted must come out as if it had not been; views after the last one missing are not traced
            together = views if tracers[key].depends_on_company else missing
            seed = job.plan.frame_seed(simulation, number)
            traced = tracers[key].trace_views(views[0].seen(frame), [view.camera for view in together], seed=seed)
            for view, reference_image in zip(together, traced, strict=True):
                if view not in missing:
                    continue
                lightmap = reference_image.lightmap
                noise = {"noise_rmse": reference_image.noise_rmse, "noise_psnr_db": reference_image.noise_psnr_db}
                facts = {"frame": number, "seed": seed, "method": tracers[key].method}
                facts |= {name: value for name, value in noise.items() if value is not None}
                path = stores[view.name].path / name
                write_exr(path, lightmap.image, lightmap.channels, _attributes(job, simulation, view, facts))
                stores[view.name].record(path, **facts, device=job.tracer_device, channels=lightmap.channels)
                yield
                if view == missing[-1]:
                    break


def sharing(views: Sequence[DatasetView]) -> list[list[DatasetView]]:
    """The views that see the same smoke, and so share its light."""
    groups: dict[float, list[DatasetView]] = defaultdict(list)
    for view in views:
        groups[view.density_scale].append(view)
    return list(groups.values())


def _run(
    job: Generation, label: str, shard_work: Any, stores: list[tuple[FrameStore, list[str]]], workers: int
) -> None:
    run_shards(
        partial(shard_work, job),
        label=label,
        start=sum(len(set(names) & store.done().keys()) for store, names in stores),
        total=sum(len(names) for _, names in stores),
        recorded=lambda: sum(store.times_recorded() for store, _ in stores),
        workers=workers,
    )


def _density_stores(job: Generation) -> list[tuple[FrameStore, list[str]]]:
    return [(job.store(job.plan.density(s)), _names(s, ".npz")) for s in job.plan.simulations]


def _guide_stores(job: Generation) -> list[tuple[FrameStore, list[str]]]:
    plan = job.plan
    views = [(s, v) for s in plan.simulations for v in s.views]
    folders = [(plan.guide(name, s, v), s) for s, v in views for name in plan.config.guides]
    folders += [(plan.flow(s, v), s) for s, v in views]
    return [(job.store(folder), _names(s, ".exr")) for folder, s in folders]


def _target_stores(job: Generation) -> list[tuple[FrameStore, list[str]]]:
    return [(job.store(job.plan.target(s, v)), _names(s, ".exr")) for s in job.plan.simulations for v in s.views]


def all_stores(job: Generation) -> list[tuple[FrameStore, list[str]]]:
    """Every folder of the dataset with the names of the files that it must hold."""
    return _density_stores(job) + _guide_stores(job) + _target_stores(job)


def _names(simulation: PlannedSimulation, suffix: str) -> list[str]:
    return [f"frame_{frame:04d}{suffix}" for frame in simulation.frames]


def _frames(plan: Plan) -> list[tuple[PlannedSimulation, int]]:
    return [(simulation, frame) for simulation in plan.simulations for frame in simulation.frames]


def channels_of(record: dict[str, Any], layer: tuple[str, ...]) -> tuple[str, ...]:
    """The channels that a frame's file holds, by its record; those of its layer where the record is silent."""
    return tuple(record.get("channels", layer))


def _attributes(
    job: Generation, simulation: PlannedSimulation, view: DatasetView, facts: dict[str, Any]
) -> dict[str, Any]:
    """What an EXR says of itself, so that a frame that left its dataset can be traced back."""
    made = provenance()
    return {
        "sixway/dataset": job.plan.config.name,
        "sixway/simulation": simulation.name,
        "sixway/view": view.name,
        "sixway/units": "maps: M = pi L / E, linear, premultiplied; alpha = 1 - T; flow: px/frame right, down",
        "sixway/commit": made["commit"],
        **{f"sixway/{key}": value for key, value in facts.items()},
    }
