"""Scores of answers whose error is known beforehand."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sixway.baselines.floors import encode_target
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.store import write_json
from sixway.data.dataset import SmokeDataset
from sixway.evaluate import _Rescaled
from sixway.evaluation.score import MASK_ALPHA, FrameScores, as_lightmap, displayed, score, summarise
from sixway.inference.predict import load_predictor
from sixway.metrics.psnr import FrameError
from sixway.shading.light import DirectionalLight

ALPHA = LIGHTMAP_CHANNELS.index("alpha")
KINDS = ("maps", "maps_masked", "alpha", "shaded", "shaded_masked")


def truths(dataset: SmokeDataset) -> np.ndarray:
    return np.concatenate([encode_target(dataset, dataset.pair(0, row)) for row in range(len(dataset) // 2)])


def test_the_truth_is_perfect(held_out: SmokeDataset, knows: Callable) -> None:
    rows = score(held_out, knows(), perceived=True)
    assert len(rows) == len(held_out) == 8
    for row in rows:
        assert [getattr(row, kind).psnr_db for kind in KINDS] == [math.inf] * 5
        assert [row.perceived[key] for key in ("maps_flip", "shaded_flip")] == [0.0, 0.0]
        assert row.perceived["maps_ssim"] == row.perceived["shaded_ssim"] == pytest.approx(1.0)
    second = [row for row in rows if "temporal_error" in row.perceived]
    assert len(second) == 4  # the second frame of every pair
    for row in second:
        assert row.perceived["temporal_error"] == row.perceived["temporal_error_of_truth"] > 0.0


def test_scores_stand_by_the_frame_they_are_of(held_out: SmokeDataset, knows: Callable) -> None:
    """Only the second frame of the last pair is wrong."""
    last = truths(held_out)[-2:]

    def change(truth: np.ndarray) -> np.ndarray:
        if np.array_equal(truth, last):
            truth[1, :ALPHA] += 0.1
        return truth

    rows = score(held_out, knows(change), perceived=False)
    wrong = [i for i, row in enumerate(rows) if row.maps.mse > 0.0]
    assert wrong == [7]
    sample = held_out.groups[0].samples[7]
    assert (rows[7].simulation, rows[7].view, rows[7].frame) == (sample.simulation, sample.view, sample.frame)


def test_a_tenth_on_every_map_is_20_db(held_out: SmokeDataset, knows: Callable, brighter: Callable) -> None:
    rows = score(held_out, knows(brighter), perceived=True)
    for row in rows:
        assert row.maps.psnr_db == pytest.approx(20.0, abs=1e-3)
        assert row.maps_masked.psnr_db == pytest.approx(20.0, abs=1e-3)
        assert {name: round(error.psnr_db, 3) for name, error in row.per_map.items()} == dict.fromkeys(DIRECTIONS, 20.0)
        assert row.alpha.psnr_db == math.inf
        assert 5.0 < row.shaded.psnr_db < 30.0
        assert row.perceived["maps_flip"] > 0.02
        assert row.perceived["maps_ssim"] < 0.99
    summary = summarise(rows)
    assert summary["psnr"]["maps"]["psnr_of_mean_mse_db"] == pytest.approx(20.0, abs=1e-3)
    assert summary["psnr"]["maps"]["mse"] == pytest.approx(0.01, rel=1e-3)


def test_one_wrong_map_is_told_by_name(held_out: SmokeDataset, knows: Callable) -> None:
    def change(truth: np.ndarray) -> np.ndarray:
        truth[:, DIRECTIONS.index("top")] += 0.1
        return truth

    summary = summarise(score(held_out, knows(change), perceived=False))
    assert summary["per_map_psnr_db"]["top"] == pytest.approx(20.0, abs=1e-3)
    assert [name for name in DIRECTIONS if summary["per_map_psnr_db"][name] is None] == [
        name for name in DIRECTIONS if name != "top"
    ]
    assert summary["psnr"]["maps"]["mse"] == pytest.approx(0.01 / 6, rel=1e-3)


def test_the_mask_is_the_true_smoke(held_out: SmokeDataset, knows: Callable) -> None:
    def change(truth: np.ndarray) -> np.ndarray:
        outside = truth[:, ALPHA : ALPHA + 1] <= MASK_ALPHA
        truth[:, :ALPHA] += 0.1 * outside
        return truth

    rows = score(held_out, knows(change), perceived=False)
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
    assert all(row.maps.mse == 0.0 for row in score(held_out, knows(change), perceived=False))


def test_lightmaps_are_decoded_before_they_are_lit() -> None:
    encoded = np.zeros((8, 12, 12), np.float32)
    encoded[DIRECTIONS.index("right")] = 0.5
    encoded[ALPHA] = 0.25
    lightmap = as_lightmap(encoded)
    np.testing.assert_allclose(lightmap["right"], 0.21404, atol=1e-5)
    np.testing.assert_allclose(lightmap["alpha"], 0.25)
    shown = displayed(lightmap, (DirectionalLight.parse("right,1,0,9"),))
    np.testing.assert_allclose(shown[0, 0], (0.5, 0.0, 1.0), atol=1e-5)  # clipped as a screen clips


def error(mse: float, coverage: float = 1.0) -> FrameError:
    return FrameError(mse=mse, coverage=coverage)


def row_of(simulation: str, mse: float, *, masked: FrameError | None = None, **perceived: float) -> FrameScores:
    return FrameScores(
        simulation=simulation,
        view="yaw",
        frame=0,
        maps=error(mse),
        maps_masked=masked or error(mse),
        alpha=error(mse),
        per_map={name: error(mse) for name in DIRECTIONS},
        shaded=error(mse),
        shaded_masked=masked or error(mse),
        perceived=perceived,
    )


def test_a_summary_gives_both_averages_and_the_worst_simulation() -> None:
    rows = [row_of("calm", 0.001), row_of("wild", 0.1), row_of("calm", 0.003), row_of("wild", 0.001)]
    summary = summarise(rows)
    maps = summary["psnr"]["maps"]
    assert maps["mean_of_psnr_db"] == pytest.approx(np.mean([30.0, 10.0, -10 * np.log10(0.003), 30.0]))
    assert maps["psnr_of_mean_mse_db"] == pytest.approx(-10.0 * np.log10(0.105 / 4))
    assert (maps["lowest_db"], maps["highest_db"]) == (pytest.approx(10.0), pytest.approx(30.0))
    assert summary["worst_simulation"] == "wild"
    assert summary["maps_psnr_by_simulation_db"] == {
        "calm": pytest.approx(-10.0 * np.log10(0.002)),
        "wild": pytest.approx(-10.0 * np.log10(0.0505)),
    }


def test_a_summary_of_the_perfect_and_the_empty_is_plain_json(tmp_path: Path) -> None:
    """Frames without smoke have no masked error and no temporal error; JSON knows neither NaN nor infinity."""
    empty = error(math.nan, coverage=0.0)
    rows = [
        row_of("a", 0.0, masked=empty, temporal_error=math.nan, maps_flip=0.25),
        row_of("a", 0.0, masked=error(0.01, 0.5), temporal_error=0.5, maps_flip=0.75),
    ]
    summary = summarise(rows)
    assert summary["perceived"] == {"maps_flip": 0.5, "temporal_error": 0.5}
    assert summary["psnr"]["maps_masked"]["psnr_of_mean_mse_db"] == pytest.approx(20.0)
    assert summary["psnr"]["maps_masked"]["mse"] == pytest.approx(0.01)
    assert summary["psnr"]["maps_masked"]["mean_coverage"] == 0.25
    assert summary["psnr"]["maps_masked"]["empty"] == 1
    write_json(tmp_path / "a.json", summary)  # refuses NaN and infinity
    assert json.loads((tmp_path / "a.json").read_text())["per_map_psnr_db"]["front"] is None
    write_json(tmp_path / "b.json", summarise([row_of("a", 0.0, masked=empty, temporal_error=math.nan)]))


def test_a_net_is_compared_in_the_dataset_s_brightness(trained_run: Path, held_out: SmokeDataset) -> None:
    predictor = load_predictor(trained_run, device="cpu")
    guide = held_out.pair(0, 0).guide.numpy()
    own = predictor.encoded(guide)
    np.testing.assert_array_equal(_Rescaled(predictor, predictor.card.scale).encoded(guide), own)
    twice = _Rescaled(predictor, 2.0 * predictor.card.scale).encoded(guide)
    np.testing.assert_array_equal(twice[:, ALPHA], own[:, ALPHA])
    for a, b in zip(own, twice, strict=True):
        np.testing.assert_allclose(as_lightmap(b).maps, 2.0 * as_lightmap(a).maps, atol=1e-5)
