"""What a report says of frames whose scores are known: averages, the headline, and the tables by condition."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from sixway.core.conventions import DIRECTIONS
from sixway.core.store import write_json
from sixway.data.manifest import Sample
from sixway.evaluation.score import FrameScores
from sixway.evaluation.summary import Headline, breakdown, describe, summarise
from sixway.metrics.psnr import FrameError

SMALL, LARGE = (128, 128), (256, 256)


def error(mse: float, coverage: float = 1.0) -> FrameError:
    return FrameError(mse=mse, coverage=coverage)


def row_of(
    simulation: str,
    mse: float,
    *,
    size: tuple[int, int] = SMALL,
    density: float = 1.0,
    yaw: float = 0.0,
    frame: int = 0,
    masked: FrameError | None = None,
    emissive: FrameError | None = None,
    **perceived: float,
) -> FrameScores:
    sample = Sample(
        simulation=simulation,
        view=f"yaw{yaw:+g}",
        frame=frame,
        yaw_deg=yaw,
        pitch_deg=0.0,
        margin=0.75,
        density_scale=density,
        seed=0,
        target="",
        target_sha256="",
    )
    masked = masked or error(mse, 0.5)
    return FrameScores(
        sample=sample,
        size=size,
        maps=error(mse),
        maps_masked=masked,
        alpha=error(mse),
        per_map={name: error(mse) for name in DIRECTIONS},
        per_map_masked={name: masked for name in DIRECTIONS},
        shaded=error(mse),
        shaded_masked=masked,
        emissive=emissive,
        perceived=perceived,
    )


def test_a_summary_gives_both_averages_and_the_worst() -> None:
    rows = [row_of("calm", 0.001), row_of("wild", 0.1, frame=7), row_of("calm", 0.003), row_of("wild", 0.001)]
    summary = summarise(rows)
    maps = summary["psnr"]["maps"]
    assert maps["mean_of_psnr_db"] == pytest.approx(np.mean([30.0, 10.0, -10 * np.log10(0.003), 30.0]))
    assert maps["psnr_of_mean_mse_db"] == pytest.approx(-10.0 * np.log10(0.105 / 4))
    assert (maps["lowest_db"], maps["highest_db"]) == (pytest.approx(10.0), pytest.approx(30.0))
    assert summary["worst_simulation"] == "wild"
    assert summary["worst_frame"] == describe(rows[1]) and summary["worst_frame"]["frame"] == 7
    assert summary["emissive"] is None and summary["flicker_ratio"] is None


def test_a_summary_of_the_perfect_and_the_empty_is_plain_json(tmp_path: Path) -> None:
    """Frames without smoke have no masked error and no temporal error; JSON knows neither NaN nor infinity."""
    empty = error(math.nan, coverage=0.0)
    rows = [
        row_of("a", 0.0, masked=empty, temporal_error=math.nan, temporal_error_of_truth=math.nan, maps_flip=0.25),
        row_of("a", 0.0, masked=error(0.01, 0.5), temporal_error=0.5, temporal_error_of_truth=0.4, maps_flip=0.75),
    ]
    summary = summarise(rows)
    assert summary["perceived"] == {"maps_flip": 0.5, "temporal_error": 0.5, "temporal_error_of_truth": 0.4}
    assert summary["flicker_ratio"] == pytest.approx(1.25)
    assert summary["perceived_frames"] == 2 and summary["sparse_frames"] == 1
    masked = summary["psnr"]["maps_masked"]
    assert masked["psnr_of_mean_mse_db"] == pytest.approx(20.0) and masked["mse"] == pytest.approx(0.01)
    assert masked["mean_coverage"] == 0.25 and masked["empty"] == 1
    write_json(tmp_path / "a.json", [summary, describe(rows[0])])  # refuses NaN and infinity
    assert json.loads((tmp_path / "a.json").read_text())[0]["per_map"]["front"]["mean_of_psnr_db"] is None
    lonely = row_of("a", 0.0, masked=empty, temporal_error=math.nan, temporal_error_of_truth=math.nan)
    write_json(tmp_path / "b.json", summarise([lonely]))


def test_maps_have_scores_of_their_own() -> None:
    row = row_of("a", 0.01, top_ssim=0.9, top_flip=0.2, back_ssim=0.8, back_flip=0.3)
    row.per_map["top"] = error(0.1)
    summary = summarise([row])
    assert summary["per_map"]["top"]["mean_of_psnr_db"] == pytest.approx(10.0)
    assert (summary["per_map"]["top"]["ssim"], summary["per_map"]["back"]["flip"]) == (0.9, 0.3)
    assert summary["per_map"]["right"]["ssim"] is None
    assert summary["per_map"]["right"]["masked"]["mean_coverage"] == 0.5
    assert summary["perceived"] == {}  # maps' own are not repeated


def test_the_headline_is_the_smallest_size_at_the_density_as_simulated() -> None:
    rows = [
        row_of("a", 0.1, size=(96, 96), density=0.5),
        row_of("a", 0.1, size=LARGE),
        row_of("a", 0.1, size=(128, 160)),
        row_of("a", 0.1, density=2.0),
    ]
    assert Headline.of(rows) == Headline(size=(128, 160), density_scale=1.0)
    assert Headline.of(rows[:1]) == Headline(size=(96, 96), density_scale=0.5)


def test_sizes_and_densities_stand_beside_the_headline_not_in_it() -> None:
    net = [
        row_of("a", 1e-4, yaw=0.0),  # 40 dB
        row_of("a", 1e-5, yaw=45.0),  # 50 dB, at one size and density alone
        row_of("a", 1e-3, yaw=0.0, size=LARGE),
        row_of("a", 1e-2, yaw=0.0, density=2.0),
        row_of("b", 1e-3, yaw=0.0, size=LARGE, density=2.0),
    ]
    found = breakdown({"net": net, "floor": net[:1]}, Headline.of(net))

    def mean(row: dict, method: str = "net") -> float:
        return row["methods"][method]["psnr"]["maps"]["mean_of_psnr_db"]

    small, large = found["size"]
    assert (small["label"], large["label"]) == ("128 x 128", "256 x 256")
    assert mean(small) == pytest.approx(45.0) and small["apart_db"] == pytest.approx(0.0)
    assert mean(large) == pytest.approx(30.0)
    assert large["apart_db"] == pytest.approx(-10.0)  # the same camera has 40 dB, not 45
    assert set(small["methods"]) == {"net", "floor"} and set(large["methods"]) == {"net"}
    assert [row["label"] for row in found["density"]] == ["x1", "x2"]
    assert found["density"][1]["apart_db"] == pytest.approx(-20.0)
    calm, other = found["simulation"]
    assert calm["label"] == "a" and calm["frames"] == 2
    assert other["label"].startswith("b (at no size") and mean(other) == pytest.approx(30.0)
    assert [row["label"] for row in found["view"]] == [f"yaw {yaw}, pitch 0, margin 0.75" for yaw in (0, 45)]
    assert [row["frames"] for row in found["coverage"]] == [5, 5]  # none is nearly empty


def test_frames_with_hardly_any_smoke_are_shown() -> None:
    net = [
        row_of("a", 1e-3),
        row_of("a", 1e-6, masked=error(1e-4, 0.005)),
        row_of("a", 0.0, masked=error(math.nan, 0.0)),
    ]
    whole = breakdown({"net": net}, Headline.of(net))["coverage"]
    assert [(row["label"], row["frames"]) for row in whole] == [
        ("smoke on 1% of the pixels or more", 1),
        ("less than 1%", 2),
        ("the whole split", 3),
    ]
    assert summarise(net)["sparse_frames"] == 2


def test_fire_counts_the_frames_that_burn() -> None:
    summary = summarise([row_of("a", 0.1, emissive=error(0.01)), row_of("a", 0.1)])
    assert summary["emissive"]["frames"] == 1
    assert summary["emissive"]["mean_of_psnr_db"] == pytest.approx(20.0)
