"""The how-to for artists: each of its commands runs, in its order, and leaves what the page promises."""

import json
import re
import shlex
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.engines.book import read_book
from sixway.volumes.vdb_write import write_vdb

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/engines/blender_houdini_to_engines.md"


def commands() -> list[list[str]]:
    """The page's commands, at the size of a test."""
    blocks = re.findall(r"```bash\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)
    lines = [line for block in blocks for line in block.strip().splitlines()]
    for large, small in (("--resolution 128", "--resolution 24"), ("--samples 8", "--samples 1")):
        assert any(large in line for line in lines)
        lines = [line.replace(large, small) for line in lines]
    return [shlex.split(line) for line in lines]


@pytest.fixture
def volumes(tmp_path: Path) -> Path:
    """Four z-up .vdb files: a ball that rises."""
    grid = Grid.centred((14, 12, 12))
    z, y, x = np.mgrid[:14, :12, :12].astype(np.float32)
    for number in range(4):
        distance = np.sqrt((x - 5.5) ** 2 + (y - 5.5) ** 2 + (z - 4.0 - 1.5 * number) ** 2)
        density = np.clip(3.5 - distance, 0.0, 1.0).astype(np.float32)
        write_vdb(tmp_path / f"smoke_{number:04d}.vdb", DensityFrame(density=density, grid=grid))
    return tmp_path


def test_every_command_of_the_page_runs(volumes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(volumes)
    ran = []
    for python, dash_m, module, *arguments in commands():
        assert (python, dash_m) == ("python", "-m")
        status = import_module(module).main(arguments)
        assert status in ((0, 1) if module.endswith("validate") else (0,)), module  # 1: a fault or no verdict
        ran.append(module)
    assert ran == ["sixway.bake", "sixway.bake", "sixway.pack", "sixway.engines.validate"]
    for name in ("RTBA", "LBFE", "MV"):
        assert Image.open(f"smoke_{name}.png").size == (8 * 24, 8 * 24)
    assert Path("maps/contact_sheet.png").is_file()
    said = json.loads(Path("smoke.json").read_text())
    assert (said["grid"], said["frames"], said["fps"]) == ({"columns": 8, "rows": 8}, 4, 24.0)
    book = read_book(Path("smoke.json"))
    channel = dict(zip(book.channels, np.moveaxis(book.frames, -1, 0), strict=True))
    thick = channel["alpha"][:3] > 0.3
    assert channel["flow_down"][:3][thick].mean() < -0.5  # the ball rises
    assert abs(channel["flow_right"][:3][thick].mean()) < 0.3
    mean_row = {name: np.average(np.arange(24), weights=channel[name].sum((0, 2))) for name in ("top", "bottom")}
    assert mean_row["top"] < mean_row["bottom"]


def test_the_page_names_only_files_that_exist() -> None:
    text = PAGE.read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:sixway|tests|assets)/[^`*]+)`", text))
    assert len(named) >= 6
    for name in named:
        assert (ROOT / name).exists(), name


def test_shaders_say_frame_units_and_curves() -> None:
    for path in (ROOT / "sixway/engines/shaders").iterdir():
        text = path.read_text(encoding="utf-8")
        assert "linear" in text and ("sRGB" in text), path.name
        if path.name != "flipbook.glsl":
            for said in ("towards the viewer", "white surface", "premultiplied"):
                assert said in text.lower(), (path.name, said)
