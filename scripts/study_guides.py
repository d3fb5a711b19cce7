"""The cost-quality curve of guides: what each costs, and what it shows with no net, a linear fit and a short training.

python scripts/study_guides.py configs/data/cpu.yaml --data runs/cpu_data --work-dir runs/guide_study \
    --train-steps 1000 --json runs/guides.json --plot runs/guides.png

Every variant is marched anew for the same pairs of a finished dataset, at its most frequent image size, into a dataset
of its own below --work-dir, and scored on the validation split: mean over frames of the PSNR of the six maps in sRGB.
All nets are trained alike. Cost: smoke of the dataset in 128^3 voxels, a picture of 256 x 256, a new frame each time;
milliseconds of one processor core, which other work on the machine disturbs little, medians of rounds through all
variants; and again at the size of the scored pictures, whose larger pixels get more rays. The same command resumes; a
variant whose settings changed is made again.
"""

import os
import statistics
import sys
import time
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp
from measurement import Measurement, parser
from scipy.ndimage import zoom

from sixway.baselines.encoding import encode_target
from sixway.baselines.floors import CoarseMaps, LinearFit
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera, Grid
from sixway.core.progress import track
from sixway.core.records import DensityFrame
from sixway.core.store import atomic_path, content_hash, read_json, sha256_file, write_json, write_text
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST, Group, Manifest, PackedArray, Split, read_manifest
from sixway.generation.plan import Plan
from sixway.generation.stages import Generation
from sixway.guide.config import GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.models.card import load_net
from sixway.models.unet import UNetConfig
from sixway.training.config import OptimiserConfig, TrainConfig
from sixway.training.loop import train

SIX = {"lights": "all", "sum_lights": False, "emission": True}
SWEEP = {**SIX, "lighting": "sweep", "pixel_samples": 4}
ONCE = {**SWEEP, "light_samples": 24, "scatter_iterations": 1}
PAPER_VARIANTS = {
    "paper": GuideConfig(),
    "paper_swept": GuideConfig(lighting="sweep", light_grid=32),
}
"""The paper's channels, marched as published and by the cheapest sweep that shows as much."""
VARIANTS = PAPER_VARIANTS | {
    "six_marched": GuideConfig(**SIX),
    "single_64": GuideConfig(**SWEEP),
    "single_96": GuideConfig(**SWEEP, light_grid=96, light_samples=24),
    "once_32": GuideConfig(**ONCE, light_grid=32),
    "once_64": GuideConfig(**ONCE, light_grid=64),
    "once_64_16_rays": GuideConfig(**ONCE | {"pixel_samples": 16}, light_grid=64),
    "once_96_coarse": GuideConfig(**ONCE, light_grid=96, scatter_cells=4),
    "once_96": GuideConfig(**ONCE, light_grid=96),
    "rich": GuideConfig(**ONCE | {"pixel_samples": 16}, light_grid=96),
}
NET = UNetConfig(widths=(32, 48, 96, 160, 256), adapter_width=24)
GUIDE = "studied"
SCORES = "scores.json"
COST_VOXELS, COST_PX = 128, 256


def main() -> int:
    options = parser(str(__doc__).splitlines()[0])
    options.add_argument("config", type=Path, help="config of the dataset, such as configs/data/cpu.yaml")
    options.add_argument("overrides", nargs="*", metavar="key=value", help="overrides that the dataset was made with")
    options.add_argument("--data", type=Path, required=True, help="the finished dataset")
    options.add_argument("--work-dir", type=Path, required=True, help="guides and nets are kept here")
    options.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS), help="default: all")
    options.add_argument("--pairs", type=int, default=400, help="training pairs (default: 400)")
    options.add_argument("--train-steps", type=int, default=0, help="steps of a net a variant (default: 0, no net)")
    options.add_argument("--plot", type=Path, help="write the curve to this PNG (extra `notebooks`: matplotlib)")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    job = Generation(plan=Plan.read(chosen.config, tuple(chosen.overrides)), out=chosen.data)
    source = Source.of(job, train_pairs=8 if chosen.quick else chosen.pairs, val_pairs=4 if chosen.quick else 40)
    about = {"data": source.manifest.name, "train_pairs": len(source.rows["train"]) // 2, "steps": chosen.train_steps}
    repetitions = 3 if chosen.quick else 9
    result = Measurement({**about, "load_before": os.getloadavg()[0]}, repetitions)
    variants = {name: VARIANTS[name] for name in chosen.variants}
    costs = costs_ms(source, PAPER_VARIANTS | variants, repetitions, edge_px=COST_PX)
    scored_px = source.groups["val"].height_px
    scored_costs = costs_ms(source, variants, repetitions, edge_px=scored_px)
    cheapest = min(costs[name] for name in PAPER_VARIANTS)
    rows: dict[str, dict[str, float]] = {}
    for name, config in variants.items():
        scores = studied(source, name, config, chosen.work_dir / name, steps=chosen.train_steps)
        rows[name] = {"cost_ms": costs[name], **scores}
        result.add(f"{name}/cost_ms", costs[name], "ms")
        result.add(f"{name}/cost_at_{scored_px}px_ms", scored_costs[name], "ms")
        result.add(f"{name}/cost_ratio", costs[name] / cheapest, "of the cheapest paper variant")
        for score, decibels in scores.items():
            result.add(f"{name}/{score}", decibels, "dB")
    if chosen.plot:
        plot(rows, chosen.plot)
    return result.finish(chosen.json)


@dataclass(frozen=True)
class Source:
    """The pairs of a dataset that every variant is studied on. rows: of the largest group of each split."""

    job: Generation
    manifest: Manifest
    groups: dict[Split, Group]
    rows: dict[Split, list[int]]

    @classmethod
    def of(cls, job: Generation, *, train_pairs: int, val_pairs: int) -> "Source":
        """Pairs spread evenly over the most frequent image size of training. ValueError if validation lacks it."""
        manifest = read_manifest(job.out)
        train_group = max(manifest.split("train"), key=lambda group: len(group.samples))
        size = (train_group.height_px, train_group.width_px)
        same = [group for group in manifest.split("val") if (group.height_px, group.width_px) == size]
        if not same:
            raise ValueError(f"{job.out}: validation has no pictures of {size} px, the most frequent in training")
        groups: dict[Split, Group] = {"train": train_group, "val": same[0]}
        wanted: dict[Split, int] = {"train": train_pairs, "val": val_pairs}
        rows: dict[Split, list[int]] = {}
        for split, group in groups.items():
            pairs = len(group.samples) // 2
            taken = np.unique(np.linspace(0, pairs - 1, min(pairs, wanted[split])).round().astype(int))
            rows[split] = [2 * int(pair) + frame for pair in taken for frame in (0, 1)]
        return cls(job=job, manifest=manifest, groups=groups, rows=rows)

    def targets(self, split: Split) -> np.ndarray:
        packed = np.load(self.job.out / self.groups[split].arrays["target"].path, mmap_mode="r")
        return packed[self.rows[split]]

    def guides(self, split: Split, config: GuideConfig) -> np.ndarray:
        """Marched anew, float16 [n, c, h, w]. A volume is read once for all its views."""
        samples = [self.groups[split].samples[row] for row in self.rows[split]]
        simulations = {simulation.name: simulation for simulation in self.job.plan.simulations}
        places: dict[tuple[str, int], list[int]] = defaultdict(list)
        for place, sample in enumerate(samples):
            places[sample.simulation, sample.frame].append(place)
        marcher = GuideMarcher(config, self.job.plan.config.medium.medium, device="cpu")
        images: dict[int, np.ndarray] = {}
        for (name, number), members in track(places.items(), total=len(places), label=f"march {split}"):
            frame = self.job.read_density(simulations[name], number)
            views = {view.name: view for view in simulations[name].views}
            for place in members:
                view = views[samples[place].view]
                seed = self.job.plan.seed(simulations[name], view, number)
                image = marcher.march(view.seen(frame), view.camera, seed=seed).image
                images[place] = np.moveaxis(image, -1, 0).astype(np.float16)
        return np.stack([images[place] for place in range(len(samples))])

    def middle_frame(self) -> DensityFrame:
        """The middle frame of the first validation simulation."""
        simulation = next(s for s in self.job.plan.simulations if s.split == "val")
        return self.job.read_density(simulation, simulation.frames[len(simulation.frames) // 2])


def studied(source: Source, name: str, config: GuideConfig, folder: Path, *, steps: int) -> dict[str, float]:
    """Scores of one variant; what the folder holds of equal settings is not made again."""
    made_by = content_hash(
        [
            config.identity(),
            source.rows,
            [group.arrays["target"].sha256 for group in source.groups.values()],
        ]
    )
    settings = TrainConfig(
        data=str(folder / f"data_{made_by}"),
        guide=GUIDE,
        net=NET,
        train=OptimiserConfig(
            steps=max(steps, 1), warmup_steps=max(steps // 50, 1), precision="bf16", pairs_per_batch=2
        ),
    )
    key = content_hash([made_by, settings.identity() if steps else None])
    path = folder / SCORES
    if path.is_file() and (known := read_json(path))["made_by"] == key:
        return known["scores"]
    print(f"variant {name}")
    data = Path(settings.data)
    if not (data / MANIFEST).is_file():
        write_dataset(source, config, data)
    training, validation = (SmokeDataset(data, guide=GUIDE, split=split) for split in ("train", "val"))
    scores = {}
    if set(DIRECTIONS) <= set(training.guide_channels):
        scores["guide_psnr_db"] = score(CoarseMaps(training), validation)
    scores["linear_psnr_db"] = score(LinearFit(training), validation)
    if steps:
        run_dir = folder / f"run_{key}"
        train(settings, run_dir=run_dir, device="cpu")
        scores["net_psnr_db"] = score(Answering(load_net(run_dir)[0]), validation)
    write_json(path, {"made_by": key, "scores": scores})
    return scores


def write_dataset(source: Source, config: GuideConfig, folder: Path) -> None:
    """A dataset of the studied pairs with one guide; the manifest last, as the sign that it is whole."""
    groups = []
    for split, group in source.groups.items():
        arrays = {}
        layers = {
            "target": (source.targets(split), group.arrays["target"].channels),
            f"guide_{GUIDE}": (source.guides(split, config), config.channels),
        }
        for layer, (values, channels) in layers.items():
            path = folder / f"{split}_{layer}.npy"
            with atomic_path(path) as partial:
                np.save(partial, values)
            arrays[layer] = PackedArray(path=path.name, sha256=sha256_file(path), channels=channels)
        samples = tuple(group.samples[row] for row in source.rows[split])
        groups.append(group.model_copy(update={"arrays": arrays, "samples": samples}))
    manifest = source.manifest.model_copy(update={"groups": tuple(groups), "guides": {GUIDE: config.identity()}})
    write_text(folder / MANIFEST, manifest.model_dump_json(indent=1) + "\n")


@dataclass(frozen=True)
class Answering:
    """A net that answers as the floors do."""

    net: torch.nn.Module

    def answer(self, guide: np.ndarray, samples: Any) -> np.ndarray:
        with torch.inference_mode():
            return self.net(torch.from_numpy(guide)).numpy()


def score(answering: Any, dataset: SmokeDataset) -> float:
    """Mean over frames of the PSNR [dB] of the six maps in sRGB."""
    decibels = []
    for number, group in enumerate(dataset.groups):
        for row in range(len(group.samples) // 2):
            pair = dataset.pair(number, row)
            answer = answering.answer(pair.guide.numpy(), group.samples[2 * row : 2 * row + 2])
            lit = len(DIRECTIONS)
            difference = np.maximum(answer[:, :lit], 0.0) - encode_target(dataset, pair)[:, :lit]
            decibels += list(-10.0 * np.log10(np.maximum((difference**2).mean(axis=(1, 2, 3)), 1e-12)))
    return float(np.mean(decibels))


def costs_ms(source: Source, variants: dict[str, GuideConfig], repetitions: int, *, edge_px: int) -> dict[str, float]:
    """Processor time of one guide of a square picture, the frame on the device included."""
    frame = source.middle_frame()
    factor = COST_VOXELS / max(frame.density.shape)
    density = np.maximum(zoom(frame.density, factor, order=1), 0.0).astype(np.float32)
    obstacle = None if frame.obstacle is None else zoom(frame.obstacle, factor, order=1).clip(0.0, 1.0)
    frame = DensityFrame(density=density, obstacle=obstacle, grid=Grid.centred(density.shape))
    camera = Camera.around(frame.grid, yaw_deg=30.0, pitch_deg=10.0, margin=0.75, width_px=edge_px, height_px=edge_px)
    medium = source.job.plan.config.medium.medium
    marchers = {name: GuideMarcher(config, medium, device="cpu") for name, config in variants.items()}
    spent: dict[str, list[float]] = defaultdict(list)
    for number in range(repetitions + 1):
        for name, marcher in marchers.items():
            started = time.process_time()
            marcher.march(replace(frame), camera, seed=1)
            if number > 0:  # the first compiles
                spent[name].append(1e3 * (time.process_time() - started))
    return {name: statistics.median(times) for name, times in spent.items()}


def plot(rows: dict[str, dict[str, float]], path: Path) -> None:
    """Cost against PSNR, one curve each for net, linear fit and the guide as it is."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("--plot needs matplotlib: pip install 'sixway[notebooks]'") from error
    figure = Figure(figsize=(8.0, 5.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for column, label, mark in (
        ("net_psnr_db", "short training", "o"),
        ("linear_psnr_db", "linear fit", "s"),
        ("guide_psnr_db", "guide as it is", "^"),
    ):
        points = [(row["cost_ms"], row[column]) for row in rows.values() if column in row]
        if points:
            axes.plot(*zip(*points, strict=True), mark, label=label)
    for name, row in rows.items():
        highest = max(value for column, value in row.items() if column.endswith("_db"))
        axes.annotate(name, (row["cost_ms"], highest), (0, 7), textcoords="offset points", ha="center", fontsize=8)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.set_xlabel(f"cost of one guide, ms ({COST_VOXELS}$^3$ voxels, {COST_PX} x {COST_PX} px, one core)")
    axes.set_ylabel("PSNR of the six maps, dB (validation)")
    axes.margins(x=0.08, y=0.1)
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    with atomic_path(path) as partial:
        figure.savefig(partial, format="png")


if __name__ == "__main__":
    sys.exit(main())
