"""Score a trained net: `python -m sixway.evaluate runs/tiny`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sixway.baselines.floors import encode_target, floors
from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.config import load_config
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.store import provenance, sha256_file
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST
from sixway.evaluation.pictures import contact_sheet
from sixway.evaluation.report import write_report
from sixway.evaluation.score import MASK_ALPHA, score, summarise
from sixway.inference.predict import Predictor, load_predictor
from sixway.training.loop import CONFIG, TrainConfig


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the report of a run; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m sixway.evaluate",
        description="PSNR, MSE, SSIM and FLIP of a run beside what needs no net, as JSON, HTML and pictures.",
    )
    parser.add_argument("run_dir", type=Path, help="folder of a trained run")
    parser.add_argument("--data", type=Path, help="dataset folder (default: the one it was trained on)")
    parser.add_argument("--split", choices=("test", "val", "train"), default="test")
    parser.add_argument("--out", type=Path, help="folder of the report (default: RUN_DIR/report_SPLIT)")
    parser.add_argument("--device", default="cpu", help="cpu or cuda (default: cpu)")
    parser.add_argument("--dry-run", action="store_true", help="check run and data, score nothing")
    options = parser.parse_args(arguments)
    try:
        predictor = load_predictor(options.run_dir, device=options.device)
        folder = options.data or Path(load_config(TrainConfig, options.run_dir / CONFIG).data)
        dataset = SmokeDataset(folder, guide=predictor.card.guide_name, split=options.split)
        if options.dry_run:
            print(f"dry run: would score {len(dataset)} {options.split} frames of {folder}")
            return 0
        out = options.out or options.run_dir / f"report_{options.split}"
        report, page = evaluate(predictor, dataset, folder, out)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for name, summary in report["methods"].items():
        maps = summary["psnr"]["maps"]
        print(f"{name:>16}: {maps['psnr_of_mean_mse_db']:.2f} dB of mean MSE, {maps['mean_of_psnr_db']:.2f} dB mean")
    print(f"report: {page}")
    return 0


def evaluate(predictor: Predictor, dataset: SmokeDataset, folder: Path, out: Path) -> tuple[dict[str, Any], Path]:
    """Score the net and the floors, write report and pictures into `out`; the report and its page.

    Raises ValueError if the dataset's guide or scale is not the one that the net was trained with.
    """
    card = predictor.card
    if dataset.guide_config != card.guide:
        raise ValueError(f"{folder}: its guide {card.guide_name!r} has another config than the net was trained on")
    train = SmokeDataset(folder, guide=card.guide_name, split="train")
    methods = {"net": summarise(score(dataset, _Rescaled(predictor, dataset.manifest.scale), perceived=True))}
    methods |= {floor.name: summarise(score(dataset, floor, perceived=False)) for floor in floors(train)}
    noise = dataset.manifest.noise_psnr_db
    report = {
        "dataset": dataset.manifest.name,
        "dataset_sha256": sha256_file(folder / MANIFEST),
        "same_data_as_training": sha256_file(folder / MANIFEST) == card.dataset_sha256,
        "split": dataset.groups[0].split,
        "guide": card.guide_name,
        "frames": len(dataset),
        "mask_alpha": MASK_ALPHA,
        "coverage": methods["net"]["psnr"]["maps_masked"]["mean_coverage"],
        "ceiling_psnr_db": None if noise is None else noise + 10.0 * float(np.log10(2.0)),
        "methods": methods,
        "loss": card.loss,
        "steps": card.steps,
        "provenance": provenance(),
    }
    pictures = {}
    group = dataset.groups[0]
    rows = sorted({0, len(group.samples) // 4, len(group.samples) // 2 - 1})
    for number, row in enumerate(rows):
        pair = dataset.pair(0, row)
        sample = group.samples[2 * row]
        guide = pair.guide.numpy()
        path = out / f"contact_sheet_{number}.png"
        contact_sheet(
            path,
            guide=guide[0],
            guide_channels=dataset.guide_channels,
            scale=dataset.manifest.scale,
            predicted=np.maximum(_Rescaled(predictor, dataset.manifest.scale).encoded(guide)[0], 0.0),
            truth=encode_target(dataset, pair)[0],
        )
        pictures[f"{sample.simulation}, {sample.view}, frame {sample.frame}"] = path
    return report, write_report(out, report, pictures)


class _Rescaled:
    """A net's answers in another dataset's brightness scale, so that both are compared alike."""

    def __init__(self, predictor: Predictor, scale: float) -> None:
        self._predictor = predictor
        self._factor = scale / predictor.card.scale

    def encoded(self, guide: np.ndarray) -> np.ndarray:
        answer = self._predictor.encoded(guide)
        if self._factor == 1.0:
            return answer
        light = [i for i, name in enumerate(LIGHTMAP_CHANNELS) if name != "alpha"]
        answer[:, light] = encode_srgb(decode_srgb(answer[:, light]) * self._factor)
        return answer


if __name__ == "__main__":
    sys.exit(main())
