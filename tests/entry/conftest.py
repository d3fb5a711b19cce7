"""Commands run in this process, and small inputs for them."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.inference.onnx import export_onnx
from sixway.models.card import load_net
from sixway.volumes.npz import write_npz


@dataclass(frozen=True)
class Outcome:
    """What a command left on the terminal."""

    status: int
    out: str
    err: str

    @property
    def error(self) -> str:
        """The one message of a command that refused its input."""
        assert self.status == 2, self
        assert "Traceback" not in self.err
        assert self.err.count("error: ") == 1, self.err
        return self.err.partition("error: ")[2].strip()


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """``run("relight", *arguments)``: the entry point of that name, as `python -m sixway.relight` would."""

    def command(name: str, *arguments: object) -> Outcome:
        main = import_module(f"sixway.{name}").main
        capsys.readouterr()
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as stop:  # argparse
            status = int(stop.code or 0)
        captured = capsys.readouterr()
        return Outcome(status=status, out=captured.out, err=captured.err)

    return command


@pytest.fixture
def refused(
    run: Callable[..., Outcome], trained_run: Path, ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[list[str], str], None]:
    """``refused(options, message)``: relight answers them with that one line and writes nothing."""

    def check(options: list[str], message: str) -> None:
        monkeypatch.chdir(tmp_path)
        told = run("relight", ball, "--checkpoint", trained_run, "-o", "out.png", *options).error
        assert re.search(message, told), told
        assert len(told.splitlines()) == 1
        assert list(tmp_path.iterdir()) == []

    return check


@pytest.fixture(scope="session")
def onnx_file(trained_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny run for 32 x 28 px."""
    path = tmp_path_factory.mktemp("entry") / "net.onnx"
    export_onnx(*load_net(trained_run), path, width_px=32, height_px=28)
    return path


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A round puff, alike from every side."""
    axis = np.linspace(-1.0, 1.0, 24, dtype=np.float32)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    density = np.clip(3.0 * (0.75 - np.sqrt(x * x + y * y + z * z)), 0.0, 1.0)
    path = tmp_path_factory.mktemp("ball") / "ball.npz"
    write_npz(path, DensityFrame(density=density, grid=Grid.centred(density.shape)))
    return path


@pytest.fixture
def three_volumes(tmp_path: Path, ball: Path) -> Path:
    """A folder of three frames: the puff fades."""
    folder = tmp_path / "frames"
    density = np.load(ball)["density"]
    for number, factor in enumerate((1.0, 0.5, 0.25)):
        frame = DensityFrame(density=np.float32(factor) * density, grid=Grid.centred(density.shape))
        write_npz(folder / f"smoke_{number}.npz", frame)
    return folder
