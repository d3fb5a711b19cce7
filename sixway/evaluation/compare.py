"""A net beside its floors and its ceiling on one split of a dataset: all numbers and pictures of a report."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sixway.baselines.floors import floors
from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.store import provenance, sha256_file, write_json
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST, Sample
from sixway.evaluation.lights import PERCEIVED_LIGHTS, SCORE_LIGHTS
from sixway.evaluation.pictures import write_pictures
from sixway.evaluation.report import write_report
from sixway.evaluation.score import MASK_ALPHA, FrameScores, score
from sixway.evaluation.summary import SPARSE, Headline, breakdown, describe, summarise
from sixway.guide.config import same_guide
from sixway.inference.predict import Predictor
from sixway.models.cost import gmac
from sixway.models.unet import SixWayUNet

FRAMES = "frames.json"


def compare(
    predictor: Predictor,
    folder: Path,
    dataset: SmokeDataset,
    out: Path,
    *,
    training: Mapping[str, Any],
    perceived_every: int = 5,
) -> tuple[dict[str, Any], Path]:
    """Score the net and the floors; write report, pictures and the score of every frame into `out`.

    dataset: the split of the dataset in `folder` to score; floors are fitted on its training split. training:
    what is known of the run, for the report. perceived_every: SSIM and FLIP on every n-th pair. Returns the
    report and its page. Raises ValueError if the dataset's guide is not the one that the net was trained with.
    """
    card = predictor.card
    if not same_guide(dataset.guide_identity, card.guide):
        raise ValueError(f"{folder}: its guide {card.guide_name!r} has another config than the net was trained on")
    started = time.perf_counter()
    train = SmokeDataset(folder, guide=card.guide_name, split="train")
    net = NetAnswers(predictor, dataset)
    methods = {"net": net, **{floor.name: floor for floor in floors(train, dataset)}}
    scores = {name: rows for name, rows in score(dataset, methods, perceived_every=perceived_every).items() if rows}
    headline = Headline.of(scores["net"])
    quoted = {name: [r for r in rows if headline.holds(r)] for name, rows in scores.items()}
    manifest, hashed = dataset.manifest, sha256_file(folder / MANIFEST)
    shape = SixWayUNet(card.net, guide_channels=card.guide_channels, guide_scale=1.0)
    report: dict[str, Any] = {
        "dataset": manifest.name,
        "dataset_sha256": hashed,
        "same_data_as_training": hashed == card.dataset_sha256,
        "split": dataset.groups[0].split,
        "guide": card.guide_name,
        "guide_channels": card.guide_channels,
        "frames": len(dataset),
        "headline": {
            "height_px": headline.size[0],
            "width_px": headline.size[1],
            "density_scale": headline.density_scale,
            "frames": len(quoted["net"]),
            "simulations": sorted({r.sample.simulation for r in quoted["net"]}),
        },
        "mask_alpha": MASK_ALPHA,
        "sparse_below": SPARSE,
        "coverage": float(np.mean([r.maps_masked.coverage for r in quoted["net"]])),
        "lights": [light.to_light for light in SCORE_LIGHTS],
        "perceived": {"every": perceived_every, "lights": PERCEIVED_LIGHTS},
        "ceiling_psnr_db": _ceiling(manifest.noise_psnr_db),
        "noise": None if manifest.noise is None else manifest.noise.model_dump(mode="json"),
        "methods": {name: summarise(rows) for name, rows in quoted.items() if rows},
        "breakdown": breakdown(scores, headline),
        "loss": card.loss,
        "steps": card.steps,
        "net": {
            **card.net.model_dump(mode="json"),
            "parameters": sum(p.numel() for p in shape.parameters()),
            "gmac": gmac(shape, *headline.size),
        },
        "training": {**training, "provenance": card.provenance},
        "provenance": provenance(),
    }
    pictures = write_pictures(out, dataset, net, worth_showing(quoted["net"]))
    report["pictures"] = {path.name: title for title, path in pictures.items()}
    write_json(out / FRAMES, {name: [describe(r) for r in rows] for name, rows in scores.items()})
    report["seconds"] = time.perf_counter() - started
    return report, write_report(out, report, pictures)


def worth_showing(rows: Sequence[FrameScores]) -> list[tuple[str, Sample]]:
    """The worst frame of all, then of each simulation the one whose PSNR is its median."""
    chosen = [("the worst frame", max(rows, key=lambda r: r.maps.mse).sample)]
    for name in sorted({r.sample.simulation for r in rows}):
        ranked = sorted((r for r in rows if r.sample.simulation == name), key=lambda r: r.maps.mse)
        chosen.append((f"the median frame of {name}", ranked[len(ranked) // 2].sample))
    return chosen


class NetAnswers:
    """A net's answers in a dataset's brightness scale, which may be another than that of its training."""

    def __init__(self, predictor: Predictor, dataset: SmokeDataset) -> None:
        self._predictor = predictor
        card = predictor.card
        maps = dataset.scale / card.scale
        fire = (dataset.emissive_scale or dataset.scale) / (card.emissive_scale or card.scale)
        self._factors = {i: fire if name == "emissive" else maps for i, name in enumerate(LIGHTMAP_CHANNELS)}
        self._factors[LIGHTMAP_CHANNELS.index("alpha")] = 1.0

    def answer(self, guide: np.ndarray, samples: tuple[Sample, ...]) -> np.ndarray:
        answer = self._predictor.encoded(guide)
        for channel, factor in self._factors.items():
            if factor != 1.0:
                answer[:, channel] = encode_srgb(decode_srgb(answer[:, channel]) * factor)
        return answer


def _ceiling(noise_psnr_db: float | None) -> float | None:
    """What a perfect net scores against one of two references of that PSNR: half the error, bias apart."""
    return None if noise_psnr_db is None else noise_psnr_db + 10.0 * float(np.log10(2.0))
