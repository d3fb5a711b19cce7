"""The report of a run: numbers that programs can read, a page that stands alone."""

import base64
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sixway import evaluate
from sixway.data.manifest import read_manifest
from sixway.evaluation.report import write_report

METHODS = ("net", "mean image", "linear fit", "guide as it is")


@pytest.fixture(scope="module")
def report_folder(trained_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("report") / "report"
    assert evaluate.main([str(trained_run), "--out", str(out), "--perceived-every", "1"]) == 0
    return out


def read_strictly(path: Path) -> dict[str, Any]:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(path.read_text(), parse_constant=refuse)


class _Page(HTMLParser):
    """The tags of a page and what its attributes lead to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_numbers_are_whole(report_folder: Path, tiny_dataset) -> None:
    report = read_strictly(report_folder / "report.json")
    assert report["split"] == "test" and report["frames"] == 8 and report["guide"] == "six"
    assert report["same_data_as_training"] is True
    quoted = report["headline"]
    assert (quoted["height_px"], quoted["width_px"], quoted["density_scale"], quoted["frames"]) == (20, 24, 1.0, 8)
    assert set(report["methods"]) == {*METHODS, "billboard baked at yaw 0"}
    for name, summary in report["methods"].items():
        frames = 8 if name in METHODS else 4  # the card is judged at yaw 30, not at the yaw of its bake
        for kind in ("maps", "maps_masked", "alpha", "shaded", "shaded_masked"):
            psnr = summary["psnr"][kind]
            assert psnr["frames"] == frames
            assert psnr["lowest_db"] <= psnr["mean_of_psnr_db"] <= psnr["highest_db"]
            # by Jensen's inequality; the two averages are two numbers
            assert psnr["psnr_of_mean_mse_db"] <= psnr["mean_of_psnr_db"] + 1e-9
            assert psnr["psnr_of_mean_mse_db"] == pytest.approx(-10.0 * np.log10(psnr["mse"]))
        assert summary["worst_simulation"] == "jet_test"
        assert summary["perceived_frames"] == frames // 2  # the first of each pair
        assert {f"{kind}_{metric}" for kind in ("maps", "shaded") for metric in ("flip", "ssim")} <= set(
            summary["perceived"]
        )
    assert 0.0 < report["coverage"] < 1.0
    assert report["methods"]["net"]["emissive"] is None
    noise = read_manifest(tiny_dataset.folder).noise_psnr_db
    assert noise is not None
    assert report["ceiling_psnr_db"] == pytest.approx(noise + 3.0103, abs=1e-3)
    assert report["provenance"]["commit"] and report["training"]["provenance"]["commit"]
    assert report["training"]["config"]["train"]["steps"] == report["steps"] == 30
    assert report["training"]["wall_seconds"] > 0.0
    assert report["net"]["parameters"] > 0 and report["net"]["gmac"] > 0.0
    assert set(report["pictures"]) == {path.name for path in report_folder.glob("*.png")}


def test_every_frame_has_its_line(report_folder: Path) -> None:
    frames = read_strictly(report_folder / "frames.json")
    report = read_strictly(report_folder / "report.json")
    assert set(frames) == set(report["methods"])
    net = frames["net"]
    assert len(net) == 8
    mean = np.mean([row["maps_db"] for row in net])
    assert mean == pytest.approx(report["methods"]["net"]["psnr"]["maps"]["mean_of_psnr_db"])
    assert report["methods"]["net"]["worst_frame"] == min(net, key=lambda row: row["maps_db"])


def test_thirty_steps_already_learn_something(report_folder: Path) -> None:
    methods = read_strictly(report_folder / "report.json")["methods"]
    net, mean = (methods[name]["psnr"]["maps"]["psnr_of_mean_mse_db"] for name in ("net", "mean image"))
    assert net > mean


def test_the_page_stands_alone(report_folder: Path) -> None:
    text = (report_folder / "report.html").read_text()
    page = _Page(text)
    assert "script" not in page.tags and "link" not in page.tags and "iframe" not in page.tags
    assert not re.search(r"https?:|url\(|@import", text)
    assert page.links and all(link.startswith("data:image/png;base64,") for link in page.links)
    pictures = {base64.b64decode(link.partition(",")[2]) for link in page.links}
    assert pictures == {path.read_bytes() for path in report_folder.glob("*.png")}


def test_the_page_shows_the_numbers(report_folder: Path) -> None:
    report = read_strictly(report_folder / "report.json")
    text = _Page((report_folder / "report.html").read_text()).text
    for name, summary in report["methods"].items():
        assert name in text
        for key in ("psnr_of_mean_mse_db", "mean_of_psnr_db"):
            assert f"{summary['psnr']['maps'][key]:.2f}" in text
    assert f"{report['ceiling_psnr_db']:.2f}" in text
    assert report["provenance"]["commit"] in text


def test_names_cannot_become_markup(report_folder: Path, tmp_path: Path) -> None:
    report = read_strictly(report_folder / "report.json")
    evil = '"><script>alert(1)</script>'
    report["dataset"] = evil
    report["methods"] = {f"net {evil}": report["methods"]["net"], "net": report["methods"]["net"]}
    report["headline"]["simulations"] = [evil]
    for row in report["breakdown"]["simulation"]:
        row["label"] = evil
    report["loss"] = {evil: evil}
    sheet = next(report_folder.glob("contact_sheet_*.png"))
    page = write_report(tmp_path, report, {evil: sheet})
    text = page.read_text()
    assert "<script" not in text
    parsed = _Page(text)
    assert "script" not in parsed.tags
    assert evil in parsed.text  # told, not swallowed


def test_a_perfect_method_and_unknown_noise_have_a_page(report_folder: Path, tmp_path: Path) -> None:
    report = read_strictly(report_folder / "report.json")
    report["ceiling_psnr_db"] = None
    report["methods"]["net"]["psnr"]["maps"] |= {"psnr_of_mean_mse_db": None, "mean_of_psnr_db": None}
    text = _Page(write_report(tmp_path, report, {}).read_text()).text
    assert "inf (inf)" in text
    assert "not measured" in text


def test_data_of_another_guide_are_refused(trained_run: Path, tiny_dataset, tmp_path: Path, capsys) -> None:
    """The same name, another config: the net never saw such a guide."""
    folder = Path(shutil.copytree(tiny_dataset.folder, tmp_path / "data"))
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["guides"]["six"]["steps_per_edge"] = 20
    (folder / "manifest.json").write_text(json.dumps(manifest))
    assert evaluate.main([str(trained_run), "--data", str(folder), "--out", str(tmp_path / "out")]) == 2
    assert "'six' has another config than the net was trained on" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
