"""Export as a user meets it: which files for whom, and options that do not go together."""

from dataclasses import dataclass
from pathlib import Path

import onnx
import pytest

from sixway.export import main
from sixway.inference.onnx_rules import Precision
from sixway.inference.predict import OnnxPredictor


@dataclass
class Told:
    status: int
    out: str
    err: str


def export(capsys: pytest.CaptureFixture[str], *arguments: object) -> Told:
    try:
        status = main([str(argument) for argument in arguments])
    except SystemExit as stop:  # argparse
        status = int(stop.code or 0)
    return Told(status, *capsys.readouterr())


@pytest.fixture
def own(trained_run: Path, tmp_path: Path) -> Path:
    """The trained net alone, in a folder to write to."""
    for name in ("model.json", "model.safetensors"):
        (tmp_path / name).write_bytes((trained_run / name).read_bytes())
    return tmp_path


def test_one_file_for_each_size(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done = export(capsys, own, "--target", "engine", "--size", "8", "--size", "16x12", "--precision", "fp16")
    assert (done.status, done.err) == (0, "")
    files = {"sixway_8x8_fp16.onnx": [1, 8, 8, 8], "sixway_16x12_fp16.onnx": [1, 8, 12, 16]}
    for name, shape in files.items():
        assert str(own / name) in done.out
        assert [d.dim_value for d in onnx.load(own / name).graph.input[0].type.tensor_type.shape.dim] == shape
    assert done.out.count("differs from torch by at most") == 2
    assert sorted(path.name for path in own.glob("*.onnx")) == sorted(files)


def test_eight_bits_for_onnx_runtime(
    own: Path,
    capsys: pytest.CaptureFixture[str],
    tiny_dataset,
    dynamic_files: dict[Precision, Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    traced = onnx.load(dynamic_files["fp32"])  # tracing takes seconds, and those files were made by it
    monkeypatch.setattr("sixway.inference.onnx.trace_dynamic", lambda net, card: traced)
    done = export(capsys, own, "--target", "ort", "--precision", "int8", "--data", tiny_dataset.folder)
    assert (done.status, done.err) == (0, "")
    assert "sixway_ort_int8.onnx" in done.out and "any multiple of 4 px, int8" in done.out
    assert OnnxPredictor(own / "sixway_ort_int8.onnx", device="cpu").card.guide_name == "six"


def test_a_dry_run_names_the_files(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(own.rglob("*"))
    done = export(capsys, own, "--dry-run", "--target", "ort", "--precision", "fp16")
    assert (done.status, done.err) == (0, "")
    assert "sixway_ort_fp16.onnx, any multiple of 4 px, fp16" in done.out
    assert sorted(own.rglob("*")) == before


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--target", "ort", "--size", "64"), "--size 64: a file for ort takes every size; leave it out"),
        (("--size", "8", "--size", "16", "-o", "x.onnx"), "--output x.onnx names one file for 2 sizes; leave it out"),
        (("--precision", "int8"), "--precision int8: engines lack its operators; add --target ort, or take fp16"),
        (("--target", "ort", "--precision", "int8"), "--data DATASET goes with --precision int8"),
        (("--data", "somewhere"), "--data DATASET goes with --precision int8"),
        (("--target", "ort", "--precision", "int8", "--data", "somewhere"), "no finished dataset here"),
        (("--target", "unity"), "invalid choice: 'unity' (choose from"),
    ],
)
def test_options_that_do_not_go_together(
    own: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], reason: str
) -> None:
    before = sorted(own.rglob("*"))
    told = export(capsys, own, *options)
    assert told.status == 2 and told.err.count("error: ") == 1
    assert reason in told.err
    assert sorted(own.rglob("*")) == before


def test_another_guide_cannot_calibrate(own: Path, capsys: pytest.CaptureFixture[str], tiny_dataset) -> None:
    card = (own / "model.json").read_text()
    (own / "model.json").write_text(
        card.replace('"steps_per_edge":40', '"steps_per_edge":41').replace(
            '"steps_per_edge": 40', '"steps_per_edge": 41'
        )
    )
    told = export(capsys, own, "--target", "ort", "--precision", "int8", "--data", tiny_dataset.folder)
    assert told.status == 2 and "its guide 'six' is not the one that this net was trained on" in told.err
