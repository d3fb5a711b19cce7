"""Train a net: `python -m sixway.train configs/train/tiny.yaml --run-dir runs/tiny`."""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import torch

from sixway.core.config import dump_config, load_config
from sixway.data.dataset import SmokeDataset
from sixway.models.card import WEIGHTS
from sixway.training.config import TrainConfig
from sixway.training.distributed import Ranks
from sixway.training.interruption import EXIT_STATUS, Interrupted
from sixway.training.log import METRICS
from sixway.training.loop import train
from sixway.training.prefetch import prefetch
from sixway.training.run import Run

_TIMED_STEPS = 4


def main(arguments: Sequence[str] | None = None) -> int:
    """Train or continue a run; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m sixway.train",
        description="Train a net on a dataset. The same command continues an interrupted run, bit for bit on a CPU.",
        epilog="example: python -m sixway.train configs/train/tiny.yaml train.lr=2e-4 --run-dir runs/tiny; "
        "several GPUs: torchrun --nproc-per-node 4 -m sixway.train ...",
    )
    parser.add_argument("config", type=Path, help="training config, such as configs/train/tiny.yaml")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="overrides, such as train.lr=2e-4")
    parser.add_argument("--run-dir", type=Path, required=True, help="folder of the run: checkpoints, logs, the net")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N (default: cpu)")
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="check config and data, print sizes and an estimate of the time from a few steps, write nothing",
    )
    options = parser.parse_intermixed_args(arguments)
    try:
        config = load_config(TrainConfig, options.config, options.overrides)
        if options.device.startswith("cuda") and not torch.cuda.is_available():
            raise ValueError(f"--device {options.device}: torch sees no CUDA device here; ask python -m sixway.doctor")
        if options.dry_run:
            print(_plan(config, device=options.device))
            return 0
        trained = train(config, run_dir=options.run_dir, device=options.device)
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        return EXIT_STATUS
    except (ValueError, OSError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    done = "trained" if trained else "was finished before, nothing was done"
    print(f"{done}: {options.run_dir / WEIGHTS}; log: {options.run_dir / METRICS}")
    return 0


def _plan(config: TrainConfig, *, device: str) -> str:
    dataset = SmokeDataset(Path(config.data), guide=config.guide, split="train")
    run = Run(config, dataset, device=device, ranks=Ranks())
    parameters = sum(p.numel() for p in run.net.parameters())
    seconds = _seconds_a_step(run)
    return (
        f"{dump_config(config)}\n{parameters:,} parameters; {len(dataset)} training frames of dataset "
        f"{dataset.manifest.name}; {config.train.steps} steps of {2 * config.train.pairs_per_batch} pictures "
        f"(of the smallest size)\nabout {config.train.steps * seconds / 60.0:.1f} min on this device as busy as it is "
        f"now ({1e3 * seconds:.0f} ms a step), validations apart\ndry run: nothing was trained"
    )


def _seconds_a_step(run: Run) -> float:
    """Mean over a few steps at the beginning, the middle and the end of the run, whose losses may differ."""
    steps, some = run.config.train.steps, max(_TIMED_STEPS, run.config.loss.auxiliary_every)
    timed = [step for begin in (0, steps // 2, steps - some) for step in range(max(0, begin), min(steps, begin + some))]
    run.step(0, run.read(0))  # the first one sets up what the others use
    batches = prefetch(lambda i: run.read(timed[i]), range(len(timed)))
    began = time.perf_counter()
    for i, batch in batches:
        float(run.step(timed[i], batch)["loss"])
    return (time.perf_counter() - began) / len(timed)


if __name__ == "__main__":
    sys.exit(main())
