"""The one command line behind `data_gen/*.py`: parse, plan, estimate, run the stages that were asked for."""

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from sixway.core.command import status_of
from sixway.core.config import dump_config
from sixway.generation import stages
from sixway.generation.estimate import estimate, print_costs
from sixway.generation.jobs import Shard, quieten_warp
from sixway.generation.pack import pack
from sixway.generation.plan import Plan
from sixway.generation.stages import Generation
from sixway.generation.verify import mixed_folders, verify
from sixway.sim.flow.flow import Flow, MakeFlow

STAGES = ("simulate", "march_guides", "trace_references", "pack", "verify")


def main(
    arguments: Sequence[str] | None = None,
    *,
    only: Sequence[str] = STAGES,
    program: str | None = None,
    make_flow: MakeFlow = Flow,
) -> int:
    """Run the stages `only`, in order; the exit status, 0 if all went well.

    program: its name in the help. make_flow: see `SmokeSolver`.

    What is wrong with the input is told in one message on standard error.
    """
    parser = argparse.ArgumentParser(
        prog=program,
        description=f"Make a dataset: {', '.join(only)}. The same command resumes what was interrupted.",
        epilog="example: python -m sixway.generate configs/data/tiny.yaml --out runs/tiny views.0.width_px=96",
    )
    parser.add_argument("config", type=Path, help="dataset config, such as configs/data/tiny.yaml")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="overrides of the config")
    parser.add_argument("--out", type=Path, required=True, help="dataset folder")
    parser.add_argument("--device", default="cpu", help="cpu or cuda (default: cpu)")
    parser.add_argument("--workers", type=int, default=2, help="processes for simulate and march_guides (default: 2)")
    parser.add_argument("--shard", metavar="I/N", help="make share I/N only, for one job of a cluster")
    parser.add_argument("--dry-run", action="store_true", help="print plan and cost, make nothing")
    parser.add_argument("--no-estimate", action="store_true", help="skip the two-frame probe")
    options = parser.parse_intermixed_args(arguments)
    quieten_warp()
    return status_of(lambda: _run(options, only, make_flow))


def _run(options: argparse.Namespace, only: Sequence[str], make_flow: MakeFlow) -> int:
    if options.workers < 1:
        raise ValueError(f"--workers {options.workers} must be at least 1")
    shard = None if options.shard is None else Shard.parse(options.shard)
    if shard and len(only) > 1:
        raise ValueError("--shard shares one stage: use its own driver, such as data_gen/trace_references.py")
    plan = Plan.read(options.config, tuple(options.overrides))
    job = Generation(plan=plan, out=options.out, device=options.device, make_flow=make_flow)
    print(_summary(plan))
    costly = set(only) & {"simulate", "march_guides", "trace_references"}
    missing = sum(len(set(names) - store.done().keys()) for store, names in stages.all_stores(job))
    if options.dry_run:
        print(dump_config(plan.config))
    if options.dry_run or (costly and missing and not options.no_estimate):
        costs = estimate(job)
        print_costs(costs, workers=options.workers)
        _check_disk(options.out, sum(cost.bytes for cost in costs))
    if options.dry_run:
        print(f"dry run: nothing was made; {missing} files are missing in {options.out}")
        return 0
    for stage in only:
        match stage:
            case "simulate" | "march_guides" | "trace_references" if shard:
                work = {
                    "simulate": stages.simulate_shard,
                    "march_guides": stages.march_shard,
                    "trace_references": stages.trace_shard,
                }[stage]
                made = sum(1 for _ in work(job, shard))
                print(f"{stage}: shard {shard.index}/{shard.count} made {made} frames")
            case "simulate":
                stages.simulate(job, workers=options.workers)
            case "march_guides":
                stages.march_guides(job, workers=options.workers)
            case "trace_references":
                stages.trace_references(job)
            case "pack":
                manifest = pack(job)
                print(f"packed: brightness scale {manifest.scale:.4f}, {_noise(manifest.noise_psnr_db)}")
                if manifest.noise is not None:
                    noise = manifest.noise
                    print(f"noise of the maps: median {noise.median_rmse:.4f} of white, worst {noise.worst_rmse:.4f}")
            case "verify":
                problems = verify(job)
                for problem in problems:
                    print(f"error: {problem}", file=sys.stderr)
                if problems:
                    return 1
                for line in mixed_folders(job):
                    print(f"note: {line}; delete the folder and run the same command again to have it of one")
                print(f"verified: every frame and array in {job.out} is whole")
    return 0


def _summary(plan: Plan) -> str:
    counts = {split: 0 for split in ("train", "val", "test")}
    for simulation in plan.simulations:
        counts[simulation.split] += len(simulation.frames) * len(simulation.views)
    frames = ", ".join(f"{count} {split}" for split, count in counts.items())
    return f"dataset {plan.config.name}: {len(plan.simulations)} simulations, views of frames: {frames}"


def _noise(psnr_db: float | None) -> str:
    if psnr_db is None:
        return "reference noise not measured (no test simulation)"
    return f"two test references differ by {psnr_db:.1f} dB, so a perfect net reaches {psnr_db + 3.01:.1f} dB"


def _check_disk(out: Path, needed: float) -> None:
    """Raise OSError before anything is made if the disk cannot hold it."""
    folder = out.absolute()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise OSError(
            f"{out}: needs about {needed / 1e9:.2f} GB, only {free / 1e9:.2f} GB are free; choose another --out"
        )
