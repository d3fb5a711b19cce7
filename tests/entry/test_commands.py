"""Train, evaluate, export, doctor, demo and the drivers of data_gen, as a user meets them."""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import onnx
import pytest
import torch

from sixway import __main__ as sixway_main
from sixway import demo

ROOT = Path(__file__).parents[2]
COMMANDS = sorted(
    path.stem for path in (ROOT / "sixway").glob("*.py") if "__main__" in path.read_text() and path.stem[0] != "_"
)
DRIVERS = sorted(path.stem for path in (ROOT / "data_gen").glob("*.py"))
TRAINING = str(ROOT / "configs/train/tiny.yaml")


def listed(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def script(name: str, *arguments: str) -> int:
    """Run data_gen/NAME.py as a program."""
    before = sys.argv
    sys.argv = [f"{name}.py", *arguments]
    try:
        runpy.run_path(str(ROOT / f"data_gen/{name}.py"), run_name="__main__")
    except SystemExit as stop:
        return int(stop.code or 0)
    finally:
        sys.argv = before
    raise AssertionError("a program ends with sys.exit")


def test_every_command_is_known_here() -> None:
    known = "bake demo doctor evaluate export generate pack relight simulate train train_flow unpack"
    assert known.split() == COMMANDS
    assert set(DRIVERS) == {"generate", "simulate", "march_guides", "trace_references", "pack", "verify"}


@pytest.mark.parametrize("name", COMMANDS)
def test_help_says_what_a_command_does(run: Callable, name: str) -> None:
    done = run(name, "--help")
    assert (done.status, done.err) == (0, "")
    assert f"python -m sixway.{name}" in done.out
    assert len(done.out.splitlines()) >= 5
    assert run(name, "--no-such-option").status == 2


@pytest.mark.parametrize("name", DRIVERS)
def test_help_of_the_drivers(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert script(name, "--help") == 0
    told = capsys.readouterr()
    assert f"{name}.py" in told.out and told.err == ""
    stages = re.search(r"Make a dataset: ([a-z_,\s]+)\.", told.out)
    assert stages
    names = [stage.strip() for stage in stages[1].split(",")]
    assert names == (
        ["simulate", "march_guides", "trace_references", "pack", "verify"] if name == "generate" else [name]
    )


def test_generate_dry_run_tells_the_cost_and_writes_nothing(run: Callable, tiny_dataset, tmp_path: Path) -> None:
    done = run("generate", tiny_dataset.config, "--out", tmp_path / "data", "--dry-run")
    assert (done.status, done.err) == (0, "")
    assert "8 train, 8 val, 8 test" in done.out and "references" in done.out
    assert re.search(r"dry run: nothing was made; \d+ files are missing", done.out)
    assert listed(tmp_path) == []


# train


def test_train_dry_run_plans_and_writes_nothing(run: Callable, tiny_dataset, tmp_path: Path) -> None:
    out = tmp_path / "run"
    data = f"data={tiny_dataset.folder}"
    done = run("train", TRAINING, data, "guide=six", "train.lr=5e-4", "--run-dir", out, "--dry-run")
    assert (done.status, done.err) == (0, "")
    assert "lr: 0.0005" in done.out and "8 training frames" in done.out and "parameters" in done.out
    assert "nothing was trained" in done.out
    assert listed(tmp_path) == []


def test_a_bad_config_tells_every_mistake_by_file_and_line(run: Callable, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("data: runs/x\nguide: six\ntrain:\n  steps: many\n  lrr: 1e-3\nlos: {mse: 1.0}\n")
    told = run("train", path, "--run-dir", tmp_path / "run").error.splitlines()
    assert len(told) == 3
    for line, key, rule in (
        ("4", "train.steps", "integer"),
        ("5", "train.lrr", "did you mean 'lr'?"),
        ("6", "los", "'loss'"),
    ):
        assert any(text.startswith(f"{path}:{line}: {key}: ") and rule in text for text in told), told
    told = run("train", TRAINING, "train.lrr=1", "--run-dir", tmp_path / "run").error
    assert told.startswith("command line: train.lrr=1: train.lrr: unknown key; did you mean 'lr'?")
    assert listed(tmp_path) == ["bad.yaml"]


def test_train_names_what_is_missing(run: Callable, tiny_dataset, tmp_path: Path) -> None:
    none, out = tmp_path / "none", tmp_path / "run"
    told = run("train", TRAINING, f"data={none}", "--run-dir", out).error
    assert str(none / "manifest.json") in told and "python data_gen/generate.py" in told
    told = run("train", tmp_path / "none.yaml", "--run-dir", out).error
    assert "none.yaml" in told
    told = run("train", TRAINING, f"data={tiny_dataset.folder}", "guide=sixx", "--run-dir", out).error
    assert "no guide variant 'sixx'; this dataset has: paper, six" in told
    assert not none.exists() and listed(tmp_path) == []


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without CUDA")
def test_a_device_that_is_not_there_is_told(
    run: Callable, tiny_dataset, trained_run: Path, ball: Path, tmp_path: Path
) -> None:
    data = f"data={tiny_dataset.folder}"
    told = run("train", TRAINING, data, "--run-dir", tmp_path / "run", "--device", "cuda").error
    assert told.startswith("--device cuda: ") and "sixway.doctor" in told
    told = run("evaluate", trained_run, "--out", tmp_path / "out", "--device", "cuda").error
    assert told.startswith("--device cuda: ")
    told = run("relight", ball, "--checkpoint", trained_run, "-o", tmp_path / "a.png", "--device", "cuda").error
    assert told.startswith("--device cuda: ")
    assert listed(tmp_path) == []


# evaluate


def test_evaluate_dry_run_writes_nothing(run: Callable, trained_run: Path) -> None:
    before = listed(trained_run)
    done = run("evaluate", trained_run, "--dry-run")
    assert (done.status, done.err) == (0, "")
    assert "would score 8 test frames" in done.out
    assert listed(trained_run) == before


def test_evaluate_scores_the_split_asked_for(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    done = run("evaluate", trained_run, "--split", "val", "--out", tmp_path / "val")
    assert (done.status, done.err) == (0, "")
    report = json.loads((tmp_path / "val/report.json").read_text())
    assert report["split"] == "val" and report["methods"]["net"]["worst_simulation"] == "jet_val"
    for name, summary in report["methods"].items():
        maps = summary["psnr"]["maps"]
        assert f"{name}: {maps['mean_of_psnr_db']:.2f} ({maps['psnr_of_mean_mse_db']:.2f}) dB, mean over" in done.out
    assert str(tmp_path / "val/report.html") in done.out
    assert (tmp_path / "val/report.html").is_file()


def test_evaluate_scores_the_best_net_on_request(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    run("evaluate", trained_run, "--best", "--split", "val", "--out", tmp_path / "best")
    best = json.loads((trained_run / "best/model.json").read_text())
    assert json.loads((tmp_path / "best/report.json").read_text())["steps"] == best["steps"]
    onnx = tmp_path / "net.onnx"
    onnx.touch()
    assert "--best chooses a net of a run" in run("evaluate", onnx, "--best").error


def test_evaluate_scores_the_best_net_of_a_run_that_goes_on(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    unfinished = tmp_path / "run"
    shutil.copytree(trained_run, unfinished)
    (unfinished / "model.json").unlink()
    done = run("evaluate", unfinished, "--best", "--split", "val", "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert "wall_seconds" not in json.loads((tmp_path / "out/report.json").read_text())["training"]
    shutil.rmtree(unfinished / "best")
    assert "best: no net here; a run keeps one" in run("evaluate", unfinished, "--best").error


def test_evaluate_names_what_is_missing(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    assert "holds no trained net" in run("evaluate", tmp_path).error
    told = run("evaluate", trained_run, "--data", tmp_path / "none", "--out", tmp_path / "out").error
    assert "no finished dataset here" in told and str(tmp_path / "none") in told
    (tmp_path / "x.onnx").write_bytes(b"not ours")
    assert "x.onnx: not a readable ONNX file" in run("evaluate", tmp_path / "x.onnx").error
    assert listed(tmp_path) == ["x.onnx"]


# export


def test_export_writes_one_file_of_the_size_asked_for(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    done = run("export", trained_run, "-o", path, "--size", "20x12")
    assert (done.status, done.err) == (0, "")
    assert str(path) in done.out
    shape = onnx.load(path).graph.input[0].type.tensor_type.shape
    assert [d.dim_value for d in shape.dim] == [1, 8, 12, 20]
    assert listed(tmp_path) == ["net.onnx"]


def test_export_dry_run_writes_nothing(run: Callable, trained_run: Path) -> None:
    before = listed(trained_run)
    done = run("export", trained_run, "--dry-run")
    assert (done.status, done.err) == (0, "")
    assert "sixway_24x20.onnx" in done.out and "transmittance" in done.out  # the training's size by default
    assert listed(trained_run) == before


def test_export_refuses_bad_input(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    assert "size 'big' is not N or WxH" in run("export", trained_run, "-o", path, "--size", "big").error
    assert "holds no trained net" in run("export", tmp_path, "-o", path).error
    (tmp_path / "folder.onnx").mkdir()
    assert "folder.onnx" in run("export", trained_run, "-o", tmp_path / "folder.onnx", "--size", "8").error
    assert listed(tmp_path) == ["folder.onnx"]


# doctor


def test_doctor_tells_what_this_machine_can_do() -> None:
    """In a process of its own: Mitsuba's LLVM must be found without help from other tests."""
    doctor = [sys.executable, "-m", "sixway.doctor"]
    done = subprocess.run(doctor, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    for what in ("torch", "warp", "mitsuba", "onnxruntime", "CPUExecutionProvider", "ffmpeg", "GB free", "Python 3."):
        assert what in done.stdout
    assert re.search(r"(llvm|scalar|cuda)_\w+", done.stdout)
    assert "LLVM" in done.stdout


# demo


def test_demo_stops_at_the_stage_that_failed(run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = []

    def stage(name: str, status: int) -> Callable[[list[str]], int]:
        return lambda arguments: (ran.append((name, arguments)), status)[1]

    monkeypatch.setattr(demo.generate, "main", stage("generate", 0))
    monkeypatch.setattr(demo.train, "main", stage("train", 2))
    monkeypatch.setattr(demo.evaluate, "main", stage("evaluate", 0))
    done = run("demo", "--out", tmp_path / "demo")
    assert done.status == 1
    assert "DEMO FAILED in stage 'train' with status 2" in done.err
    assert [name for name, _ in ran] == ["generate", "train"]
    configs = [argument for _, arguments in ran for argument in arguments if argument.endswith(".yaml")]
    assert [Path(config).is_file() for config in configs] == [True, True]


@pytest.mark.parametrize(
    ("mean", "fit", "status"),
    [(20.0, 25.0, 0), (24.5, 25.0, 1), (20.0, 30.5, 1)],
    ids=["good", "near mean", "below fit"],
)
def test_demo_fails_if_the_net_is_not_worth_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mean: float, fit: float, status: int
) -> None:
    """The net has 30 dB: 6 dB over the mean image and more than the linear fit, or it failed."""
    scores = {"net": 30.0, "mean image": mean, "linear fit": fit}
    methods = {name: {"psnr": {"maps": {"psnr_of_mean_mse_db": value}}} for name, value in scores.items()}
    (tmp_path / "report").mkdir()
    (tmp_path / "report/report.json").write_text(json.dumps({"methods": methods, "ceiling_psnr_db": 50.0}))
    (tmp_path / "report/contact_sheet_1.png").write_bytes(b"picture")
    assert demo._conclude(tmp_path, {"train": 1.0}) == status
    told = capsys.readouterr()
    assert ("DEMO FAILED" in told.err) == bool(status)
    assert str(tmp_path / "contact_sheet.png") in told.out and (tmp_path / "contact_sheet.png").is_file()
    assert str(tmp_path / "report/report.html") in told.out


def test_demo_relights_on_its_device_and_real_volumes_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs: list[list[str]] = []
    monkeypatch.setattr(demo.relight, "main", lambda job: (jobs.append(job), len(jobs) == 2)[1])
    frames = tmp_path / "dataset/density/cylinder_b/0123"
    frames.mkdir(parents=True)
    (frames / "frame_0000.npz").touch()
    (frames / "frame_0017.npz").touch()
    (tmp_path / "real").mkdir()
    (tmp_path / "real/mitsuba_tutorial_volume.vol").touch()
    monkeypatch.setenv("SIXWAY_REAL_VOLUMES", str(tmp_path / "real"))
    places = (tmp_path, tmp_path / "dataset", tmp_path / "run", tmp_path / "net.onnx")
    assert demo._relight_all(*places, ["--device", "cuda"]) == 1  # one of them failed
    assert len(jobs) == 3
    assert all(Path(job[0]).name in ("frame_0017.npz", "mitsuba_tutorial_volume.vol") for job in jobs)
    assert ["cuda" in job for job in jobs] == [str(tmp_path / "run") in job for job in jobs] == [True, False, True]
    assert "z" in jobs[2]


# whole programs


def test_modules_run_as_programs(tmp_path: Path, ball: Path) -> None:
    """One real process: exit status 2, one line on stderr, no traceback."""
    command = [sys.executable, "-m", "sixway.relight", str(ball), "--checkpoint", str(tmp_path), "-o", "a.png"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 2
    assert done.stderr.strip().splitlines()[-1].startswith(f"error: {tmp_path}: holds no trained net")
    assert "Traceback" not in done.stderr
    assert listed(tmp_path) == []


def test_sixway_lists_every_command_and_runs_it(capsys: pytest.CaptureFixture[str]) -> None:
    listed_commands = [name for group in sixway_main.COMMANDS.values() for name in group]
    assert sorted(listed_commands) == COMMANDS
    assert sixway_main.main(["--help"]) == 0
    told = capsys.readouterr().out
    assert all(f"  {name} " in told for name in COMMANDS)
    assert sixway_main.main(["relit"]) == 2
    assert "no command 'relit'" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        sixway_main.main(["generate", "--help"])
    assert stop.value.code == 0 and "--shard" in capsys.readouterr().out


def test_a_command_whose_package_is_missing_says_so() -> None:
    program = "import sys; sys.modules['PIL'] = None; from sixway.__main__ import main; sys.exit(main(['pack', 'x']))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr == "error: sixway pack needs the package PIL; run: pip install sixway\n"
