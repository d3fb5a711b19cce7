"""Train the flow estimator: `python -m sixway.train_flow configs/train/flow.yaml --run-dir runs/flow`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from sixway.core.command import status_of
from sixway.core.config import dump_config, load_config
from sixway.core.progress import track
from sixway.models.flownet import WEIGHTS, FlowNet
from sixway.training.flow import FlowTrainConfig, train_flow
from sixway.training.flow_data import FlowData
from sixway.training.interruption import EXIT_STATUS, Interrupted


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the clips that are missing, then train or continue a run; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m sixway.train_flow",
        description="Train FlowNet on simulated smoke. The same command continues an interrupted run.",
        epilog="example: python -m sixway.train_flow configs/train/flow.yaml train.steps=500 --run-dir runs/flow_short",
    )
    parser.add_argument("config", type=Path, help="training config, such as configs/train/flow.yaml")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="overrides, such as train.lr=5e-4")
    parser.add_argument("--run-dir", type=Path, required=True, help="folder of the run: checkpoint, log, weights, card")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N (default: cpu)")
    parser.add_argument("--dry-run", action="store_true", help="print config and sizes, make and train nothing")
    options = parser.parse_intermixed_args(arguments)
    return status_of(lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    config = load_config(FlowTrainConfig, options.config, options.overrides)
    data = FlowData.read(config.clips, scenarios_from=options.config.parent, folder=Path(config.data))
    missing = data.missing(("train", "val"))
    if options.dry_run:
        parameters = sum(p.numel() for p in FlowNet(config.net).parameters())
        print(f"{dump_config(config)}\n{parameters:,} parameters; {len(missing)} simulations to make: {missing}")
        print("dry run: nothing was made or trained")
        return 0
    if options.device.startswith("cuda") and not torch.cuda.is_available():
        raise ValueError(f"--device {options.device}: torch sees no CUDA device here; ask python -m sixway.doctor")
    if missing:
        made = data.make(("train", "val"), device=options.device, threads=torch.get_num_threads())
        for _ in track(made, total=len(missing), label="simulate"):
            pass
    try:
        scores = train_flow(config, data, run_dir=options.run_dir, device=options.device)
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        return EXIT_STATUS
    print(f"trained: {options.run_dir / WEIGHTS}; {', '.join(f'{name} {value}' for name, value in scores.items())}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
