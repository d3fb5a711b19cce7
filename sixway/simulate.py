"""Simulate smoke: `python -m sixway.simulate configs/sim/jet.yaml --out runs/sim/jet`."""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import warp as wp

from sixway.core.command import status_of
from sixway.core.config import load_config
from sixway.core.frames import Grid
from sixway.core.png import write_png
from sixway.core.progress import track
from sixway.extras.moments import make_flow
from sixway.generation.preview import filmstrip
from sixway.generation.simulation import Format, SimulationRun
from sixway.sim.scenario import ScenarioConfig


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate every frame that is missing; the exit status."""
    options = _parser().parse_args(arguments)
    wp.config.log_level = wp.LOG_WARNING  # Warp greets on first use
    return status_of(lambda: _run(options))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sixway.simulate",
        description="Simulate a scenario to a sequence of volumes. The same command continues where it stopped, and "
        "with more frames it goes on from the end.",
        epilog="example: python -m sixway.simulate configs/sim/jet_bunny.yaml --out bunny --format npz nvdb "
        "--set resolution=medium --set frames=100",
    )
    add = parser.add_argument
    add("scenario", type=Path, help="scenario file, such as configs/sim/jet.yaml")
    add("--out", type=Path, required=True, help="folder for frame_0000.npz, ..., checkpoint.npz and strip.png")
    add("--format", nargs="+", choices=get_args(Format), default=["npz"], help="files of each frame (default: npz)")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="change a value of the scenario")
    add("--checkpoint-every", type=int, default=10, help="frames between two checkpoints, 0 for none (default: 10)")
    add("--threads", type=int, default=os.cpu_count(), help="CPU threads (default: all)")
    add("--device", default="cpu", help="cpu or cuda (default: cpu)")
    add("--replace", action="store_true", help="delete what the folder holds of other settings")
    add("--no-strip", action="store_true", help="make no strip.png of six frames at the end")
    add("--dry-run", action="store_true", help="time two frames, say what the run would cost, write nothing")
    return parser


def _run(options: argparse.Namespace) -> int:
    scenario = load_config(ScenarioConfig, options.scenario, options.set)
    job = SimulationRun(
        scenario=scenario,
        out=options.out,
        formats=tuple(dict.fromkeys(options.format)),
        checkpoint_every=max(0, options.checkpoint_every),
        device=options.device,
        threads=max(1, options.threads),
        replace=options.replace,
        make_flow=make_flow,
    )
    timing = scenario.timing
    print(
        f"{scenario.name}: air {_size(scenario.velocity_grid)}, smoke {_size(scenario.density_grid)}; "
        f"{scenario.warmup_frames} + {scenario.frames} frames of {1e3 * scenario.frame_s:.3g} ms, "
        f"{timing.steps_per_frame} lattice steps each; {scenario.flow.lattice} {scenario.flow.model}"
    )
    if options.dry_run:
        return _dry_run(job)
    missing = job.missing()
    for _ in track(job.run(), total=scenario.frames, label=scenario.name, start=scenario.frames - len(missing)):
        pass
    if len(job.devices()) > 1:
        print(f"note: frames were made on {' and '.join(job.devices())}; they need not fit together bit by bit")
    if not options.no_strip:
        strip = options.out / "strip.png"
        write_png(strip, filmstrip(job.some_frames(6), device=options.device))
        print(f"picture: {strip}")
    print(f"simulated: {options.out}")
    return 0


def _dry_run(job: SimulationRun) -> int:
    solver = job.fresh_solver()
    solver.advance()  # compiles
    start = time.perf_counter()
    for _ in range(2):
        solver.advance()
    each = (time.perf_counter() - start) / 2
    frames = job.scenario.warmup_frames + job.scenario.frames
    bytes_each = solver.frame().density.nbytes
    print(
        f"dry run: {each:.2f} s a young frame, about {frames * each / 60.0:.1f} min for {frames}; old smoke costs more"
    )
    print(f"a frame holds {bytes_each / 1e6:.0f} MB of density before compression; nothing was written to {job.out}")
    return 0


def _size(grid: Grid) -> str:
    return " x ".join(str(n) for n in reversed(grid.shape_zyx))


if __name__ == "__main__":
    sys.exit(main())
