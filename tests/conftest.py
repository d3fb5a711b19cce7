"""Fixtures that every test folder shares."""

import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import hypothesis
import numpy as np
import pytest

from sixway.core.store import sha256_file

# CI draws the same examples every time, so that a change is judged by what it changed; people draw new ones.
hypothesis.settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    hypothesis.settings.load_profile("ci")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="cpu or cuda: where the kernels under test run")


@pytest.fixture
def device(request: pytest.FixtureRequest) -> str:
    """The device that kernels and nets run on; `pytest --device cuda` runs the same tests there."""
    name: str = request.config.getoption("--device")
    if name == "cuda":
        import torch

        if not torch.cuda.is_available():
            pytest.skip("no CUDA device on this machine")
    return name


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def real_volumes() -> Path:
    """The folder with volumes that nobody here wrote."""
    folder = os.environ.get("SIXWAY_REAL_VOLUMES")
    if not folder or not Path(folder).is_dir():
        pytest.skip("SIXWAY_REAL_VOLUMES names no folder with real volumes")
    return Path(folder)


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> Iterator[None]:
    """Pictures and nets under test are tiny: one thread is faster than several, above all on a shared machine."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@dataclass(frozen=True)
class TinyDataset:
    """A finished dataset and the config that made it. Tests share it: whoever alters it copies it first."""

    folder: Path
    config: Path


_SCENARIO = """\
name: puff
resolution: {cells: 12, refinement: 2}
frames: 8
warmup_frames: 8
smoke: {buoyancy_m_s2: 1.0}
inlets:
  - {centre_m: [0.05, -0.5, 0.0], radius_m: 0.14, towards: [0.0, 1.0, 0.0], speed_m_s: 1.0, swirl: 0.8, turbulence: 0.4}
"""

_DATASET = """\
name: test_tiny
seed: 3
simulations:
  - {name: jet, split: train, scenario: puff.yaml, set: [seed=1]}
  - {name: jet_val, split: val, scenario: puff.yaml, set: [seed=2]}
  - {name: jet_test, split: test, scenario: puff.yaml, set: [seed=3]}
pairs_per_simulation: 2
views: [{yaws_deg: [0, 30], margin: 0.75, width_px: 24, height_px: 20}]
medium: {extinction_per_m: 40.0}
guides:
  six: {lights: [right, left, top, bottom, front, back], sum_lights: false}
  paper: {lights: [front, top, bottom], sum_lights: true}
reference: {samples: 1}
"""

_TRAINING = """\
data: %s
guide: six
net: {widths: [8, 12], adapter_width: 8, adapter_blocks: 1}
train: {steps: 30, pairs_per_batch: 2, lr: 2e-3, warmup_steps: 5, ema: 0.9, log_every: 5, validate_every: 15}
"""


@pytest.fixture(scope="session")
def tiny_dataset(tmp_path_factory: pytest.TempPathFactory) -> TinyDataset:
    """Three simulations (train, val, test) of four frames and two views, 24 x 20 px, by the real pipeline."""
    from sixway.generation.command import main

    home = tmp_path_factory.mktemp("tiny")
    (home / "puff.yaml").write_text(_SCENARIO)
    (home / "tiny.yaml").write_text(_DATASET)
    arguments = [str(home / "tiny.yaml"), "--out", str(home / "data"), "--workers", "1", "--no-estimate"]
    assert main(arguments) == 0
    return TinyDataset(folder=home / "data", config=home / "tiny.yaml")


@pytest.fixture(scope="session")
def mixed_dataset(tiny_dataset: TinyDataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what training reads of the tiny dataset, a quarter of the pairs at twice the size too."""
    folder = tmp_path_factory.mktemp("mixed") / "data"
    shutil.copytree(tiny_dataset.folder / "packed", folder / "packed")
    manifest = json.loads((tiny_dataset.folder / "manifest.json").read_text())
    for group in list(manifest["groups"]):
        arrays = {}
        for name, array in group["arrays"].items():
            values = np.load(folder / array["path"])[:2].repeat(2, axis=2).repeat(2, axis=3)
            path = folder / "packed" / f"large_{group['split']}_{name}.npy"
            np.save(path, values)
            arrays[name] = {**array, "path": f"packed/{path.name}", "sha256": sha256_file(path)}
        size = {"height_px": 2 * group["height_px"], "width_px": 2 * group["width_px"]}
        manifest["groups"].append({**group, **size, "arrays": arrays, "samples": group["samples"][:2]})
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


@pytest.fixture(scope="session")
def trained_run(tiny_dataset: TinyDataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of 30 steps on the tiny dataset; `train.yaml` beside it is its config."""
    from sixway.train import main

    home = tmp_path_factory.mktemp("run")
    (home / "train.yaml").write_text(_TRAINING % tiny_dataset.folder)
    assert main([str(home / "train.yaml"), "--run-dir", str(home / "run")]) == 0
    return home / "run"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Seconds of each test folder, so that a slow room shows."""
    seconds: dict[str, float] = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                folder = str(Path(report.nodeid.partition("::")[0]).parent)
                seconds[folder] = seconds.get(folder, 0.0) + report.duration
    terminalreporter.section("time of each test folder")
    for folder, spent in sorted(seconds.items(), key=lambda item: -item[1]):
        terminalreporter.write_line(f"{spent:7.1f} s  {folder}")
