"""Train a net: `python -m sixway.train configs/train/tiny.yaml --run-dir runs/tiny`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from sixway.core.config import dump_config, load_config
from sixway.data.dataset import SmokeDataset
from sixway.models.unet import SixWayUNet
from sixway.training.log import METRICS
from sixway.training.loop import Interrupted, TrainConfig, train


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
    parser.add_argument("--dry-run", action="store_true", help="check config and data, print sizes, train nothing")
    options = parser.parse_intermixed_args(arguments)
    try:
        config = load_config(TrainConfig, options.config, options.overrides)
        if options.dry_run:
            print(_plan(config))
            return 0
        if options.device.startswith("cuda") and not torch.cuda.is_available():
            raise ValueError(f"--device {options.device}: torch sees no CUDA device here; ask python -m sixway.doctor")
        train(config, run_dir=options.run_dir, device=options.device)
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        return 130
    except (ValueError, OSError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"trained: {options.run_dir / 'model.safetensors'}; log: {options.run_dir / METRICS}")
    return 0


def _plan(config: TrainConfig) -> str:
    dataset = SmokeDataset(Path(config.data), guide=config.guide, split="train")
    net = SixWayUNet(config.net, guide_channels=dataset.guide_channels, guide_scale=dataset.manifest.scale)
    parameters = sum(p.numel() for p in net.parameters())
    return (
        f"{dump_config(config)}\n{parameters:,} parameters; {len(dataset)} training frames of dataset "
        f"{dataset.manifest.name}; {config.train.steps} steps of {2 * config.train.pairs_per_batch} pictures\n"
        "dry run: nothing was trained"
    )


if __name__ == "__main__":
    sys.exit(main())
