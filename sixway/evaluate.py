"""Score a trained net: `python -m sixway.evaluate runs/tiny`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sixway.core.command import status_of
from sixway.core.config import load_config
from sixway.core.store import read_json
from sixway.data.dataset import SmokeDataset
from sixway.evaluation.compare import compare
from sixway.evaluation.tables import both
from sixway.inference.predict import load_predictor
from sixway.models.card import CARD
from sixway.training.loop import BEST, CONFIG, TrainConfig

RECORD = "run.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the report of a run; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m sixway.evaluate",
        description="PSNR, MSE, SSIM and FLIP of a run beside what needs no net, as JSON, HTML and pictures.",
        epilog="example: python -m sixway.evaluate runs/tiny --best; one core takes about 1 s a frame of 128 x 128",
    )
    parser.add_argument("run_dir", type=Path, help="folder of a trained run, or an .onnx file with --data and --out")
    parser.add_argument("--data", type=Path, help="dataset folder (default: the one it was trained on)")
    parser.add_argument("--best", action="store_true", help="the net of the best validation instead of the last step's")
    parser.add_argument("--split", choices=("test", "val", "train"), default="test")
    parser.add_argument("--out", type=Path, help="folder of the report (default: RUN_DIR/report_SPLIT)")
    parser.add_argument("--device", default="cpu", help="cpu or cuda (default: cpu)")
    parser.add_argument(
        "--perceived-every", type=int, default=5, metavar="N", help="SSIM and FLIP on every N-th pair (default: 5)"
    )
    parser.add_argument("--dry-run", action="store_true", help="check run and data, score nothing")
    options = parser.parse_args(arguments)
    return status_of(lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    if options.perceived_every < 1:
        raise ValueError(f"--perceived-every {options.perceived_every} must be at least 1, which is every pair")
    if options.best and options.run_dir.is_file():
        raise ValueError(f"{options.run_dir}: --best chooses a net of a run's folder; an ONNX file holds one net")
    if options.best and not (options.run_dir / BEST).is_dir():
        raise FileNotFoundError(
            f"{options.run_dir / BEST}: no net here; a run keeps one from its first validation on, so train further"
        )
    predictor = load_predictor(options.run_dir / BEST if options.best else options.run_dir, device=options.device)
    training = _training(options.run_dir)
    if options.run_dir.is_file() and not (options.data and options.out):
        raise ValueError(f"{options.run_dir}: of an ONNX file name the dataset with --data and the report with --out")
    folder = options.data or Path(training["config"]["data"])
    dataset = SmokeDataset(folder, guide=predictor.card.guide_name, split=options.split)
    if options.dry_run:
        print(f"dry run: would score {len(dataset)} {options.split} frames of {folder}")
        return 0
    out = options.out or options.run_dir / f"report_{options.split}"
    report, page = compare(predictor, folder, dataset, out, training=training, perceived_every=options.perceived_every)
    for name, summary in report["methods"].items():
        print(f"{name:>25}: {both(summary['psnr']['maps'])} dB, mean over frames (of the mean MSE)")
    print(f"report: {page}, {report['seconds']:.0f} s")
    return 0


def _training(run_dir: Path) -> dict[str, Any]:
    """What the folder of a run says of its training: config and record; nothing of an ONNX file."""
    if run_dir.is_file():
        return {}
    told: dict[str, Any] = {"config": load_config(TrainConfig, run_dir / CONFIG, stored=True).identity()}
    record, end = run_dir / RECORD, run_dir / CARD
    if record.is_file():
        told["record"] = read_json(record)
    if record.is_file() and end.is_file():  # a run that has not ended has a best net, but no length
        told["wall_seconds"] = end.stat().st_mtime - record.stat().st_mtime  # pauses count as well
    return told


if __name__ == "__main__":
    sys.exit(main())
