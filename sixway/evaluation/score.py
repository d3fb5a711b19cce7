"""Scores of anything that answers a guide, frame by frame, on (a) the six maps and (b) shaded pictures.

Maps are compared in sRGB with the dataset's brightness scale; shaded pictures as displayed (sRGB, clipped
to [0, 1]) under a fixed list of lights. Data range 1 everywhere.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from sixway.baselines.floors import encode_target
from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.records import SixWayLightmap
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Sample
from sixway.metrics.flip import flip
from sixway.metrics.psnr import FrameError, mse, summarise_psnr
from sixway.metrics.ssim import ssim
from sixway.metrics.temporal import temporal_error
from sixway.shading.compose import shade
from sixway.shading.light import DirectionalLight

MASK_ALPHA = 0.02
"""Foreground: where the true alpha exceeds this."""

TEST_LIGHTS: dict[str, tuple[DirectionalLight, ...]] = {
    "sun from the right": (DirectionalLight.parse("right,1.0,0.95,0.85"),),
    "moon from the top left": (DirectionalLight.parse("-1:1:0.3,0.75,0.85,1.0"),),
    "back light": (DirectionalLight.parse("0.3:0.4:-1,1.6,1.3,1.0"),),
    "red below, blue above": (
        DirectionalLight.parse("bottom,1.0,0.25,0.1"),
        DirectionalLight.parse("0.2:1:0.5,0.3,0.5,1.0"),
    ),
}
"""The fixed light set of the shaded scores and of the contact sheet; camera frame."""


@runtime_checkable
class Answers(Protocol):
    """A net, an ONNX file, or a floor."""

    def encoded(self, guide: np.ndarray) -> np.ndarray: ...


@dataclass
class FrameScores:
    """All scores of one frame; `masked` means over the foreground alone."""

    simulation: str
    view: str
    frame: int
    maps: FrameError
    maps_masked: FrameError
    alpha: FrameError
    per_map: dict[str, FrameError]
    shaded: FrameError
    shaded_masked: FrameError
    perceived: dict[str, float] = field(default_factory=dict)


def score(dataset: SmokeDataset, answers: Answers, *, perceived: bool) -> list[FrameScores]:
    """Scores of every frame of the split. perceived: SSIM, FLIP and temporal error as well (slower)."""
    rows = []
    for number, group in enumerate(dataset.groups):
        flows = dataset.flows[number]
        for row in range(len(group.samples) // 2):
            pair = dataset.pair(number, row)
            truth = encode_target(dataset, pair)
            predicted = np.maximum(answers.encoded(pair.guide.numpy()), 0.0)
            scores = [
                _score_frame(group.samples[2 * row + i], predicted[i], truth[i], perceived=perceived) for i in range(2)
            ]
            if perceived and flows is not None:
                flow = np.moveaxis(flows[2 * row + 1].astype(np.float32), 0, -1)
                scores[1].perceived |= _temporal(predicted, truth, flow)
            rows += scores
    return rows


def as_lightmap(encoded: np.ndarray) -> SixWayLightmap:
    """Encoded channels [8, h, w] to linear maps that still carry the brightness scale, for shading."""
    image = np.moveaxis(encoded, 0, -1)[..., : len(LIGHTMAP_CHANNELS) - 1].astype(np.float32)
    alpha = LIGHTMAP_CHANNELS.index("alpha")
    linear = np.concatenate([decode_srgb(image[..., :alpha]), np.clip(image[..., alpha:], 0.0, 1.0)], axis=-1)
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=np.maximum(linear, 0.0).astype(np.float32))


def displayed(lightmap: SixWayLightmap, lights: tuple[DirectionalLight, ...]) -> np.ndarray:
    """The shaded picture on black as a screen shows it: sRGB in [0, 1], [h, w, 3]."""
    return np.clip(encode_srgb(shade(lightmap, lights)), 0.0, 1.0).astype(np.float32)


def _score_frame(sample: Sample, predicted: np.ndarray, truth: np.ndarray, *, perceived: bool) -> FrameScores:
    lit = len(DIRECTIONS)
    maps_p, maps_t = (np.ascontiguousarray(np.moveaxis(x[:lit], 0, -1)) for x in (predicted, truth))
    alpha = LIGHTMAP_CHANNELS.index("alpha")
    alpha_p, alpha_t = predicted[alpha][..., None], truth[alpha][..., None]
    mask = truth[alpha] > MASK_ALPHA
    pictures = [
        (displayed(as_lightmap(predicted), lights), displayed(as_lightmap(truth), lights))
        for lights in TEST_LIGHTS.values()
    ]
    shaded_p, shaded_t = (np.concatenate(side, axis=-1) for side in zip(*pictures, strict=True))
    scores = FrameScores(
        simulation=sample.simulation,
        view=sample.view,
        frame=sample.frame,
        maps=mse(predicted=maps_p, reference=maps_t),
        maps_masked=mse(predicted=maps_p, reference=maps_t, mask=mask),
        alpha=mse(predicted=alpha_p, reference=alpha_t),
        per_map={
            name: mse(predicted=maps_p[..., i : i + 1], reference=maps_t[..., i : i + 1])
            for i, name in enumerate(DIRECTIONS)
        },
        shaded=mse(predicted=shaded_p, reference=shaded_t),
        shaded_masked=mse(predicted=shaded_p, reference=shaded_t, mask=mask),
    )
    if perceived:
        clipped_p, clipped_t = np.clip(maps_p, 0.0, 1.0), np.clip(maps_t, 0.0, 1.0)
        scores.perceived = {
            "maps_ssim": ssim(predicted=clipped_p, reference=clipped_t),
            "maps_flip": float(
                np.mean(
                    [
                        flip(predicted=clipped_p[..., i : i + 1], reference=clipped_t[..., i : i + 1]).mean
                        for i in range(lit)
                    ]
                )
            ),
            "shaded_ssim": float(np.mean([ssim(predicted=p, reference=t) for p, t in pictures])),
            "shaded_flip": float(np.mean([flip(predicted=p, reference=t).mean for p, t in pictures])),
        }
    return scores


def _temporal(predicted: np.ndarray, truth: np.ndarray, flow: np.ndarray) -> dict[str, float]:
    """How much a sequence changes beyond its motion, the prediction's and the truth's own.

    The flow stored with a frame leads to the next one; over a frame's time it also tells where its
    pixels came from.
    """
    lit = len(DIRECTIONS)
    mask = truth[1][LIGHTMAP_CHANNELS.index("alpha")] > MASK_ALPHA

    def error(maps: np.ndarray) -> float:
        current, previous = (np.ascontiguousarray(np.moveaxis(maps[i, :lit], 0, -1)) for i in (1, 0))
        return temporal_error(current=current, previous=previous, flow=flow, mask=mask).mean_abs

    return {"temporal_error": error(predicted), "temporal_error_of_truth": error(truth)}


def summarise(rows: list[FrameScores]) -> dict[str, Any]:
    """Tables of the scores: per kind PSNR both ways, per map, the perceived means, the worst simulation."""
    kinds: dict[str, Callable[[FrameScores], FrameError]] = {
        "maps": lambda r: r.maps,
        "maps_masked": lambda r: r.maps_masked,
        "alpha": lambda r: r.alpha,
        "shaded": lambda r: r.shaded,
        "shaded_masked": lambda r: r.shaded_masked,
    }
    psnr = {kind: _plain(asdict(summarise_psnr([pick(r) for r in rows]))) for kind, pick in kinds.items()}
    for kind, pick in kinds.items():
        seen = [pick(r).mse for r in rows if pick(r).coverage > 0.0]
        psnr[kind]["mse"] = float(np.mean(seen)) if seen else None
    simulations = sorted({r.simulation for r in rows})
    by_simulation = {
        name: summarise_psnr([r.maps for r in rows if r.simulation == name]).psnr_of_mean_mse_db for name in simulations
    }
    per_map = {name: summarise_psnr([r.per_map[name] for r in rows]).psnr_of_mean_mse_db for name in DIRECTIONS}
    perceived: dict[str, list[float]] = {}
    for r in rows:
        for key, value in r.perceived.items():
            if math.isfinite(value):  # a frame without smoke has no temporal error
                perceived.setdefault(key, []).append(value)
    return {
        "psnr": psnr,
        "per_map_psnr_db": _plain(per_map),
        "perceived": {key: float(np.mean(perceived[key])) for key in sorted(perceived)},
        "maps_psnr_by_simulation_db": _plain(by_simulation),
        "worst_simulation": min(by_simulation, key=lambda name: by_simulation[name]),
    }


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """JSON knows no infinity or NaN: they become None."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()}
