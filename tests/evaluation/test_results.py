"""docs/results.md from reports alone, and the plan of the ablation."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image

from sixway import evaluate
from sixway.core.store import read_json, write_json

SCRIPTS = Path(__file__).parents[2] / "scripts"


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def run(trained_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tiny run with its report."""
    folder = tmp_path_factory.mktemp("results") / "rich"
    shutil.copytree(trained_run, folder)
    assert evaluate.main([str(folder), "--perceived-every", "3"]) == 0
    return folder


def ablated(run: Path, folder: Path) -> Path:
    """Reports of two variants with two seeds, whose scores are known."""
    for variant, values in (("full", (40.0, 41.0)), ("no_flow", (38.0, 38.5))):
        for seed, value in enumerate(values):
            report = read_json(run / "report_test/report.json")
            report["methods"]["net"]["psnr"]["maps"]["mean_of_psnr_db"] = value
            write_json(folder / variant / f"seed{seed}" / "report_test/report.json", report)
    return folder


def test_the_page_is_made_of_reports(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "paper"
    shutil.copytree(run, other)
    rows = [
        {"name": "guide", "value": 3.25, "unit": "ms", "bound": "<= 2", "ok": False},
        {"name": "spare", "value": None, "unit": "dB", "bound": "", "ok": True},
    ]
    about = {"commit": "abc", "hardware": "two cores", "config": {}, "repetitions": 1, "seconds": 12.0}
    write_json(tmp_path / "floors.json", {"rows": rows, **about})
    twice = [
        {"name": "path", "value": value, "unit": unit, "bound": "", "ok": True}
        for value, unit in ((12.0, "ms"), (30.5, "dB"))
    ]
    write_json(tmp_path / "inference.json", {"rows": twice, **about})
    curve = [
        {"name": f"{name}/cost_ms", "value": value, "unit": "ms", "bound": "", "ok": True}
        for name, value in (("paper", 80.0), ("rich", 92.5))
    ] + [{"name": "rich/net_psnr_db", "value": 41.0, "unit": "dB", "bound": ">= 42", "ok": False}]
    write_json(tmp_path / "guides.json", {"rows": curve, **about})
    Image.new("RGB", (8, 8)).save(tmp_path / "guides.png")
    out = tmp_path / "docs/results.md"
    ablation = ablated(run, tmp_path / "ablation")
    measured = [f"--{name}={tmp_path / name}.json" for name in ("guides", "floors", "inference")]
    options = ["--ablation", str(ablation), *measured, "--out", str(out)]
    assert script("make_results").main([str(run), str(other), *options]) == 0
    page = out.read_text()
    report = read_json(run / "report_test/report.json")
    maps = report["methods"]["net"]["psnr"]["maps"]
    assert f"**rich** (guide `six`): {maps['mean_of_psnr_db']:.2f} dB" in page
    assert f"| rich: net | {maps['mean_of_psnr_db']:.2f} ({maps['psnr_of_mean_mse_db']:.2f}) |" in page
    assert "| paper: linear fit |" in page and "| rich: ceiling" in page
    assert report["training"]["provenance"]["commit"] in page and report["training"]["provenance"]["hardware"] in page
    assert "| full | 2 | 40.50 (40.00 to 41.00) |  |" in page
    assert "| no flow | 2 | 38.25 (38.00 to 38.50) | -2.25 |" in page
    assert "| guide | 3.25 | ms | <= 2 | MISSED |" in page and "| spare | none | dB |  |  |" in page
    assert "|  | cost [ms] | net psnr [dB] |" in page
    assert "| paper | 80 |  |" in page and "| rich | 92.5 | 41 MISSED (>= 42) |" in page
    assert "|  | ms | dB |" in page and "| path | 12 | 30.5 |" in page
    for absent in ("validate_volumes", "validate_exports"):
        assert f"Not run: `python scripts/{absent}.py" in page
    assert "No frame of the test split burns." in page
    shown = {path.name for path in (out.parent / "images").iterdir()}
    assert shown == {f"results_{name}" for name in (*report["pictures"], "guides.png")}
    assert all(f"](images/{name})" in page for name in shown)
    with Image.open(out.parent / "images/results_contact_sheet_0.png") as small:
        with Image.open(run / "report_test/contact_sheet_0.png") as whole:
            assert small.size == whole.size
    capsys.readouterr()


def test_a_run_without_a_report_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert script("make_results").main([str(tmp_path), "--out", str(tmp_path / "r.md")]) == 2
    assert f"run: python -m sixway.evaluate {tmp_path}" in capsys.readouterr().err
    assert not (tmp_path / "r.md").exists()


@pytest.fixture
def base(tiny_dataset, tmp_path: Path) -> Path:
    """A training config that has all parts."""
    path = tmp_path / "base.yaml"
    path.write_text(
        f"data: {tiny_dataset.folder}\nguide: six\n"
        "net: {widths: [8, 12], adapter_width: 8, adapter_blocks: 1}\n"
        "train: {steps: 5, pairs_per_batch: 1}\n"
        "loss: {perceptual: 0.1, features: gradients, flow: 0.1, estimator: lucas_kanade}\n"
    )
    return path


def test_the_ablation_leaves_out_one_part_at_a_time(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [str(base), "train.lr=1e-3", "--steps", "3", "--seeds", "2", "--out", str(tmp_path / "ablation")]
    assert script("ablate").main([*options, "--dry-run"]) == 0
    said = capsys.readouterr().out
    lines = [line for line in said.splitlines() if "sixway.train" in line]
    assert len(lines) == 10 and "10 runs, 0 of them done" in said
    assert all("train.steps=3 train.lr=1e-3" in line for line in lines)
    first = lines[:5]  # all variants with one seed come before the second seed
    assert all("train.seed=0" in line for line in first) and all("train.seed=1" in line for line in lines[5:])
    for part in ("net.adapters=false", "loss.perceptual=0", "loss.flow=0", "loss.colour=linear"):
        assert sum(part in line for line in first) == 1
    assert not (tmp_path / "ablation").exists()


def test_a_part_that_is_absent_cannot_be_left_out(base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert script("ablate").main([str(base), "loss.flow=0", "--only", "no_flow", "--dry-run"]) == 2
    assert "no_flow" in capsys.readouterr().err


def test_what_is_done_is_not_done_again(base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One trial with a report of its config, one with a report of another: only the second is run."""
    ablate = script("ablate")
    out = tmp_path / "ablation"
    options = [str(base), "--seeds", "1", "--only", "full", "no_flow", "--out", str(out)]
    ran = []

    def fake(self) -> tuple[str, int, float]:  # type: ignore[no-untyped-def]
        ran.append(self.variant)
        maps = {"psnr": {"maps": {"mean_of_psnr_db": 1.0}}}
        config = self.config.model_dump(mode="json")
        write_json(self.folder / ablate.REPORT, {"training": {"config": config}, "methods": {"net": maps}})
        return self.variant, 0, 1.0

    monkeypatch.setattr(ablate.Trial, "run", fake)
    assert ablate.main(options) == 0 and sorted(ran) == ["full", "no_flow"]
    path = out / "no_flow/seed0" / ablate.REPORT
    report = json.loads(path.read_text())
    report["training"]["config"]["train"]["steps"] = 7
    write_json(path, report)
    ran.clear()
    assert ablate.main(options) == 0 and ran == ["no_flow"]
