"""Scores of answers whose error is known beforehand."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sixway.baselines.encoding import encode_target
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS, TO_LIGHT
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Sample
from sixway.evaluation.compare import NetAnswers
from sixway.evaluation.lights import PERCEIVED_LIGHTS, SCORE_LIGHTS
from sixway.evaluation.score import BURNING, MASK_ALPHA, Answers, FrameScores, as_lightmap, score, shaded
from sixway.evaluation.summary import summarise
from sixway.inference.predict import load_predictor
from sixway.metrics.temporal import temporal_error
from sixway.shading.compose import shade

ALPHA = LIGHTMAP_CHANNELS.index("alpha")
EMISSIVE = LIGHTMAP_CHANNELS.index("emissive")
KINDS = ("maps", "maps_masked", "alpha", "shaded", "shaded_masked")


def scored(dataset: SmokeDataset, answers: Answers, *, perceived_every: int = 1000) -> list[FrameScores]:
    """SSIM and FLIP of the first frame alone unless asked for."""
    return score(dataset, {"one": answers}, perceived_every=perceived_every)["one"]


def truths(dataset: SmokeDataset) -> np.ndarray:
    return np.concatenate([encode_target(dataset, dataset.pair(0, row)) for row in range(len(dataset) // 2)])


def test_the_truth_is_perfect(held_out: SmokeDataset, knows: Callable) -> None:
    rows = scored(held_out, knows(), perceived_every=1)
    assert len(rows) == len(held_out) == 8
    for row in rows:
        assert [getattr(row, kind).psnr_db for kind in KINDS] == [math.inf] * 5
        assert row.emissive is None  # no fire in this dataset
    for row in rows[::2]:  # the first frame of every pair
        assert [row.perceived[key] for key in ("maps_flip", "shaded_flip", "top_flip")] == [0.0, 0.0, 0.0]
        assert row.perceived["maps_ssim"] == row.perceived["shaded_ssim"] == pytest.approx(1.0)
    for row in rows[1::2]:  # the second one has a past
        assert set(row.perceived) == {"temporal_error", "temporal_error_of_truth", "flicker_of_error"}
        assert row.perceived["temporal_error"] == row.perceived["temporal_error_of_truth"] > 0.0
        assert row.perceived["flicker_of_error"] == 0.0


def test_scores_stand_by_the_frame_they_are_of(held_out: SmokeDataset, knows: Callable) -> None:
    """Only the second frame of the last pair is wrong."""
    last = truths(held_out)[-2:]

    def change(truth: np.ndarray) -> np.ndarray:
        if np.array_equal(truth, last):
            truth[1, :ALPHA] += 0.1
        return truth

    rows = scored(held_out, knows(change))
    wrong = [i for i, row in enumerate(rows) if row.maps.mse > 0.0]
    assert wrong == [7]
    sample = held_out.groups[0].samples[7]
    assert rows[7].sample == sample and rows[7].size == (20, 24)


def test_a_tenth_on_every_map_is_20_db(held_out: SmokeDataset, knows: Callable, brighter: Callable) -> None:
    rows = scored(held_out, knows(brighter), perceived_every=2)
    for row in rows:
        assert row.maps.psnr_db == pytest.approx(20.0, abs=1e-3)
        assert row.maps_masked.psnr_db == pytest.approx(20.0, abs=1e-3)
        assert {name: round(error.psnr_db, 3) for name, error in row.per_map.items()} == dict.fromkeys(DIRECTIONS, 20.0)
        assert row.alpha.psnr_db == math.inf
        assert 5.0 < row.shaded.psnr_db < 30.0
        assert row.per_map_masked["back"].psnr_db == pytest.approx(20.0, abs=1e-3)
    looked = [row.perceived for row in rows if "maps_flip" in row.perceived]
    assert [("maps_flip" in row.perceived) for row in rows] == [True, False, False, False] * 2  # every second pair
    assert all(found["maps_flip"] > 0.02 and found["maps_ssim"] < 0.99 for found in looked)
    assert all(
        found["maps_flip"] == pytest.approx(np.mean([found[f"{d}_flip"] for d in DIRECTIONS])) for found in looked
    )
    summary = summarise(rows)
    assert summary["psnr"]["maps"]["psnr_of_mean_mse_db"] == pytest.approx(20.0, abs=1e-3)
    assert summary["psnr"]["maps"]["mse"] == pytest.approx(0.01, rel=1e-3)


def test_one_wrong_map_is_told_by_name(held_out: SmokeDataset, knows: Callable) -> None:
    def change(truth: np.ndarray) -> np.ndarray:
        truth[:, DIRECTIONS.index("top")] += 0.1
        return truth

    summary = summarise(scored(held_out, knows(change)))
    assert summary["per_map"]["top"]["psnr_of_mean_mse_db"] == pytest.approx(20.0, abs=1e-3)
    perfect = [name for name in DIRECTIONS if summary["per_map"][name]["psnr_of_mean_mse_db"] is None]
    assert perfect == [name for name in DIRECTIONS if name != "top"]
    assert summary["psnr"]["maps"]["mse"] == pytest.approx(0.01 / 6, rel=1e-3)


def test_the_mask_is_the_true_smoke(held_out: SmokeDataset, knows: Callable) -> None:
    def change(truth: np.ndarray) -> np.ndarray:
        outside = truth[:, ALPHA : ALPHA + 1] <= MASK_ALPHA
        truth[:, :ALPHA] += 0.1 * outside
        return truth

    rows = scored(held_out, knows(change))
    for row, truth in zip(rows, truths(held_out), strict=True):
        covered = float((truth[ALPHA] > MASK_ALPHA).mean())
        assert 0.0 < covered < 1.0
        assert row.maps_masked.coverage == row.shaded_masked.coverage == pytest.approx(covered)
        assert row.maps_masked.mse == row.shaded_masked.mse == 0.0
        assert row.maps.mse == pytest.approx(0.01 * (1.0 - covered), rel=1e-3)


def test_less_than_no_light_counts_as_none(held_out: SmokeDataset, knows: Callable) -> None:
    def change(truth: np.ndarray) -> np.ndarray:
        return np.where(truth == 0.0, np.float32(-0.5), truth)

    assert (truths(held_out) == 0.0).any()
    assert all(row.maps.mse == 0.0 for row in scored(held_out, knows(change)))


def test_lightmaps_are_decoded_before_they_are_lit() -> None:
    encoded = np.zeros((8, 12, 12), np.float32)
    encoded[DIRECTIONS.index("right")] = 0.5
    encoded[ALPHA] = 0.25
    lightmap = as_lightmap(encoded)
    np.testing.assert_allclose(lightmap["right"], 0.21404, atol=1e-5)
    np.testing.assert_allclose(lightmap["alpha"], 0.25)


def test_shaded_scores_are_of_what_the_shader_shows(rng: np.random.Generator) -> None:
    """The 16 pictures are those of `shade`, sRGB-encoded and clipped as a screen clips."""
    encoded = np.concatenate([rng.uniform(0.0, 1.3, (6, 5, 7)), np.ones((2, 5, 7))]).astype(np.float32)
    pictures = shaded(np.ascontiguousarray(np.moveaxis(encoded[:6], 0, -1)))
    assert pictures.shape == (5, 7, 16) and pictures.max() == 1.0
    for i, light in enumerate(SCORE_LIGHTS):
        linear = shade(as_lightmap(encoded), [light])[..., 0].astype(np.float64)
        expected = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
        np.testing.assert_allclose(pictures[..., i], np.clip(expected, 0.0, 1.0), atol=2e-6)


def test_the_lights_are_spread_and_none_is_a_map() -> None:
    to_light = np.array([light.to_light for light in SCORE_LIGHTS])
    assert all(light.colour == (1.0, 1.0, 1.0) for light in SCORE_LIGHTS)
    between = np.degrees(np.arccos(np.clip(to_light @ to_light.T, -1.0, 1.0)))
    assert between[~np.eye(16, dtype=bool)].min() > 45.0
    axes = np.degrees(np.arccos(to_light @ np.array(list(TO_LIGHT.values())).T))
    assert axes.min() > 18.0
    assert len(PERCEIVED_LIGHTS) == 4
    np.testing.assert_allclose(to_light.mean(0), 0.0, atol=0.04)  # no side is preferred


class Burning(SmokeDataset):
    """The dataset with fire in the first pair: a square of emissive."""

    def pair(self, group: int, row: int):  # type: ignore[no-untyped-def]
        pair = super().pair(group, row)
        if row == 0:
            pair.target[:, EMISSIVE, 4:8, 4:8] = 1.0 / self.scale
        return pair


def test_fire_is_scored_where_it_burns(tiny_dataset, held_out: SmokeDataset) -> None:
    burning = Burning(tiny_dataset.folder, guide="six", split="test")

    class Cold:
        def answer(self, guide: np.ndarray, samples: tuple[Sample, ...]) -> np.ndarray:
            rows = (row for row in range(4) if np.array_equal(burning.pair(0, row).guide.numpy(), guide))
            answer = encode_target(burning, burning.pair(0, next(rows)))
            answer[:, EMISSIVE] -= 0.1 * (answer[:, EMISSIVE] > BURNING)
            return answer

    rows = scored(burning, Cold())
    assert [row.emissive is not None for row in rows] == [True, True, *[False] * 6]
    summary = summarise(rows)
    assert summary["emissive"]["frames"] == 2
    assert summary["emissive"]["mse"] == pytest.approx(0.01 * 16 / (20 * 24), rel=1e-4)
    assert summary["psnr"]["maps"]["mse"] == summary["psnr"]["shaded"]["mse"] == 0.0  # apart from all else


def test_what_a_method_does_not_answer_does_not_count(held_out: SmokeDataset, knows: Callable) -> None:
    truth = knows()

    class Shy:
        def answer(self, guide: np.ndarray, samples: tuple[Sample, ...]) -> np.ndarray | None:
            return None if samples[0].yaw_deg == 0.0 else truth.answer(guide, samples)

    found = score(held_out, {"all": truth, "shy": Shy()}, perceived_every=1000)
    assert len(found["all"]) == 8 and len(found["shy"]) == 4
    assert {row.sample.yaw_deg for row in found["shy"]} == {30.0}


def test_an_error_that_flickers_is_told_from_one_that_stays(held_out: SmokeDataset, knows: Callable) -> None:
    def flickering(truth: np.ndarray) -> np.ndarray:
        truth[1, :ALPHA] += 0.1
        return truth

    def staying(truth: np.ndarray) -> np.ndarray:
        truth[:, :ALPHA] += 0.1
        return truth

    for change, expected in ((flickering, 0.1), (staying, 0.0)):
        rows = scored(held_out, knows(change))[1::2]
        for row in rows:
            assert row.perceived["flicker_of_error"] == pytest.approx(expected, abs=1e-6)


def test_temporal_errors_follow_the_simulator_s_motion(held_out: SmokeDataset, knows: Callable) -> None:
    """The same number as the metric gives for the flow that the dataset stores with the second frame."""
    row = scored(held_out, knows())[3]
    truth = np.moveaxis(truths(held_out)[2:4], 1, -1)
    flows = held_out.flows[0]
    assert flows is not None
    flow = np.moveaxis(flows[3].astype(np.float32), 0, -1)
    expected = temporal_error(
        current=truth[1][..., :6], previous=truth[0][..., :6], flow=flow, mask=truth[1][..., ALPHA] > MASK_ALPHA
    )
    assert row.perceived["temporal_error_of_truth"] == pytest.approx(expected.mean_abs, rel=1e-6)


def test_a_net_is_compared_in_the_dataset_s_brightness(trained_run: Path, tiny_dataset) -> None:
    predictor = load_predictor(trained_run, device="cpu")
    dataset = SmokeDataset(tiny_dataset.folder, guide="six", split="test")
    guide = dataset.pair(0, 0).guide.numpy()
    own = predictor.encoded(guide)
    np.testing.assert_array_equal(NetAnswers(predictor, dataset).answer(guide, ()), own)
    dataset.manifest = dataset.manifest.model_copy(update={"scale": 2.0 * predictor.card.scale})
    twice = NetAnswers(predictor, dataset).answer(guide, ())
    np.testing.assert_array_equal(twice[:, ALPHA], own[:, ALPHA])
    for a, b in zip(own, twice, strict=True):
        np.testing.assert_allclose(as_lightmap(b).maps, 2.0 * as_lightmap(a).maps, atol=1e-5)
