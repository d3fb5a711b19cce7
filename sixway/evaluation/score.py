"""Scores of anything that answers a guide, frame by frame, on (a) the six maps and (b) shaded pictures.

Maps are compared in sRGB with the dataset's brightness scale; shaded pictures as displayed (sRGB, clipped
to [0, 1]) under 16 fixed white lights, one at a time. Data range 1 everywhere. Fire is apart: the shaded
pictures leave it out and emissive has a score of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from sixway.baselines.encoding import encode_target
from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.records import SixWayLightmap
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Sample
from sixway.evaluation.lights import PERCEIVED_LIGHTS, score_weights
from sixway.metrics.flip import flip
from sixway.metrics.psnr import FrameError, mse
from sixway.metrics.ssim import ssim
from sixway.metrics.temporal import temporal_error

MASK_ALPHA = 0.02
"""Foreground: where the true alpha exceeds this."""

BURNING = 0.02
"""A frame burns if its true emissive, sRGB-encoded, exceeds this anywhere."""

_LIT = len(DIRECTIONS)
_ALPHA = LIGHTMAP_CHANNELS.index("alpha")
_EMISSIVE = LIGHTMAP_CHANNELS.index("emissive")
_WEIGHTS = score_weights()


@runtime_checkable
class Answers(Protocol):
    """A net or a floor. None: there is nothing to answer for these frames, they do not count."""

    def answer(
        self, guide: Float[np.ndarray, "n g h w"], samples: tuple[Sample, ...]
    ) -> Float[np.ndarray, "n 8 h w"] | None: ...


@dataclass(frozen=True, kw_only=True)
class FrameScores:
    """All scores of one frame; `masked` means over the foreground alone.

    shaded: over the pictures of all 16 lights. emissive: of a frame that burns, else None. perceived: SSIM,
    FLIP (of the frames that they are computed for) and temporal errors (of second frames of pairs).
    """

    sample: Sample
    size: tuple[int, int]
    """Height and width [px]."""
    maps: FrameError
    maps_masked: FrameError
    alpha: FrameError
    per_map: dict[str, FrameError]
    per_map_masked: dict[str, FrameError]
    shaded: FrameError
    shaded_masked: FrameError
    emissive: FrameError | None = None
    perceived: dict[str, float] = field(default_factory=dict)


def score(
    dataset: SmokeDataset, methods: Mapping[str, Answers], *, perceived_every: int
) -> dict[str, list[FrameScores]]:
    """Scores of every method on every frame of the split, by the method's name.

    perceived_every: SSIM and FLIP, which are slow, on the first frame of every n-th pair.
    """
    scores: dict[str, list[FrameScores]] = {name: [] for name in methods}
    for number, group in enumerate(dataset.groups):
        flows = dataset.flows[number]
        for row in range(len(group.samples) // 2):
            pair = dataset.pair(number, row)
            guide = pair.guide.numpy()
            samples = group.samples[2 * row : 2 * row + 2]
            truth = [_Frame(encoded) for encoded in encode_target(dataset, pair)]
            flow = None if flows is None else np.moveaxis(flows[2 * row + 1].astype(np.float32), 0, -1)
            for name, method in methods.items():
                answer = method.answer(guide, samples)
                if answer is None:
                    continue
                given = [_Frame(np.maximum(encoded, 0.0)) for encoded in answer]
                found: list[dict[str, float]] = [{}, {}]
                if row % perceived_every == 0:
                    found[0] = _perceived(given[0], truth[0])
                if flow is not None:
                    found[1] = _temporal(given, truth, flow)
                scores[name] += [_scores(samples[i], given[i], truth[i], found[i]) for i in range(2)]
    return scores


def as_lightmap(encoded: Float[np.ndarray, "8 h w"]) -> SixWayLightmap:
    """Encoded channels to linear maps and alpha that still carry the brightness scale, for shading."""
    image = np.moveaxis(encoded, 0, -1)[..., : len(LIGHTMAP_CHANNELS) - 1].astype(np.float32)
    linear = np.concatenate([decode_srgb(image[..., :_ALPHA]), np.clip(image[..., _ALPHA:], 0.0, 1.0)], axis=-1)
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=np.maximum(linear, 0.0).astype(np.float32))


def shaded(encoded_maps: Float[np.ndarray, "h w 6"]) -> Float[np.ndarray, "h w 16"]:
    """Grey pictures on black under each of the `SCORE_LIGHTS`, as a screen shows them: sRGB in [0, 1]."""
    shaded: np.ndarray = np.clip(encode_srgb(decode_srgb(encoded_maps) @ _WEIGHTS), 0.0, 1.0)
    return shaded


class _Frame:
    """One lightmap as all scores look at it."""

    def __init__(self, encoded: Float[np.ndarray, "8 h w"]) -> None:
        self.encoded = encoded
        self.maps = np.ascontiguousarray(np.moveaxis(encoded[:_LIT], 0, -1), np.float32)
        self.shaded = shaded(self.maps)


def _scores(sample: Sample, given: _Frame, truth: _Frame, perceived: dict[str, float]) -> FrameScores:
    mask = truth.encoded[_ALPHA] > MASK_ALPHA
    burns = truth.encoded[_EMISSIVE].max() > BURNING

    def channel(index: int, *, masked: bool = False) -> FrameError:
        return mse(
            predicted=given.encoded[index][..., None],
            reference=truth.encoded[index][..., None],
            mask=mask if masked else None,
        )

    return FrameScores(
        sample=sample,
        size=(mask.shape[0], mask.shape[1]),
        maps=mse(predicted=given.maps, reference=truth.maps),
        maps_masked=mse(predicted=given.maps, reference=truth.maps, mask=mask),
        alpha=channel(_ALPHA),
        per_map={name: channel(i) for i, name in enumerate(DIRECTIONS)},
        per_map_masked={name: channel(i, masked=True) for i, name in enumerate(DIRECTIONS)},
        shaded=mse(predicted=given.shaded, reference=truth.shaded),
        shaded_masked=mse(predicted=given.shaded, reference=truth.shaded, mask=mask),
        emissive=channel(_EMISSIVE) if burns else None,
        perceived=perceived,
    )


def _perceived(given: _Frame, truth: _Frame) -> dict[str, float]:
    """SSIM and FLIP of each map, of all maps, and of the pictures under some of the lights."""
    maps_p, maps_t = np.clip(given.maps, 0.0, 1.0), np.clip(truth.maps, 0.0, 1.0)
    found: dict[str, float] = {}
    for i, name in enumerate(DIRECTIONS):
        pair = {"predicted": maps_p[..., i : i + 1], "reference": maps_t[..., i : i + 1]}
        found[f"{name}_ssim"], found[f"{name}_flip"] = ssim(**pair), flip(**pair).mean
    for metric in ("ssim", "flip"):
        found[f"maps_{metric}"] = float(np.mean([found[f"{name}_{metric}"] for name in DIRECTIONS]))
    lights = np.array(PERCEIVED_LIGHTS)
    shaded_p, shaded_t = given.shaded[..., lights], truth.shaded[..., lights]
    found["shaded_ssim"] = ssim(predicted=shaded_p, reference=shaded_t)
    found["shaded_flip"] = float(
        np.mean(
            [
                flip(predicted=shaded_p[..., i : i + 1], reference=shaded_t[..., i : i + 1]).mean
                for i in range(len(lights))
            ]
        )
    )
    return found


def _temporal(given: list[_Frame], truth: list[_Frame], flow: Float[np.ndarray, "h w 2"]) -> dict[str, float]:
    """How much a sequence changes beyond its motion: the answer, the truth, and the answer's own error.

    flow: the simulator's, stored with the second frame. It leads to the next one; over a frame's time it also
    tells where its pixels came from. The error's own flicker is 0 for a perfect answer, and for one whose
    faults move with the smoke.
    """
    mask = truth[1].encoded[_ALPHA] > MASK_ALPHA

    def error(previous: np.ndarray, current: np.ndarray) -> float:
        return temporal_error(current=current, previous=previous, flow=flow, mask=mask).mean_abs

    return {
        "temporal_error": error(given[0].maps, given[1].maps),
        "temporal_error_of_truth": error(truth[0].maps, truth[1].maps),
        "flicker_of_error": error(given[0].maps - truth[0].maps, given[1].maps - truth[1].maps),
    }
