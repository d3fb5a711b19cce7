"""`python -m sixway.simulate` on real files."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixway.core.store import read_json_lines
from sixway.generation.simulation import INDEX, SimulationRun
from sixway.sim.scenario import ScenarioConfig
from sixway.simulate import main
from sixway.volumes.read import CHECKPOINT, read_volume

SCENARIO = """\
name: puff
resolution: {cells: 12, refinement: 2}
frames: 4
warmup_frames: 1
inlets:
  - {centre_m: [0.0, -0.5, 0.0], radius_m: 0.15}
obstacles:
  - {kind: sphere, centre_m: [0.0, 0.15, 0.0], radius_m: 0.15}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "puff.yaml"
    path.write_text(SCENARIO)
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("frame_*"))


def test_frames_in_every_format_and_a_picture(scenario: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main([str(scenario), "--out", str(out), "--format", "npz", "nvdb", "vdb"]) == 0
    assert len(names(out)) == 12
    frames = [read_volume(out / f"frame_0003.{suffix}") for suffix in ("npz", "nvdb", "vdb")]
    assert frames[0].obstacle is not None and frames[0].velocity_m_s is not None
    for frame in frames[1:]:
        assert frame.density.sum() == pytest.approx(frames[0].density.sum(), rel=1e-5)
        assert frame.grid.voxel_size_m == pytest.approx(frames[0].grid.voxel_size_m)
    told = read_json_lines(out / INDEX)
    assert [line["frame"] for line in told] == [0, 1, 2, 3]
    assert told[3]["time_s"] == pytest.approx(5 / 20.0)
    assert told[3]["voxel_size_m"] == pytest.approx(frames[1].grid.voxel_size_m)
    with Image.open(out / "strip.png") as strip:
        assert strip.width == 4 * strip.height  # four frames of a cube


def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(scenario: Path, tmp_path: Path) -> None:
    from sixway.core.config import load_config

    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert main([str(scenario), "--out", str(whole), "--no-strip", "--threads", "1"]) == 0
    job = SimulationRun(scenario=load_config(ScenarioConfig, scenario), out=killed, checkpoint_every=2)
    next(run := job.run())
    next(run)
    run.close()  # as a kill would, in the middle
    assert (killed / CHECKPOINT).is_file() and names(killed) == ["frame_0000.npz", "frame_0001.npz"]
    assert main([str(scenario), "--out", str(killed), "--no-strip", "--threads", "1"]) == 0
    assert names(killed) == names(whole)
    for name in names(whole):
        np.testing.assert_array_equal(read_volume(whole / name).density, read_volume(killed / name).density)


def test_more_frames_go_on_from_the_end(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    command = [str(scenario), "--out", str(out), "--no-strip"]
    assert main([*command, "--checkpoint-every", "1"]) == 0
    before = {name: (out / name).stat().st_mtime_ns for name in names(out)}
    assert main([*command, "--set", "frames=6"]) == 0
    assert len(names(out)) == 6
    assert all((out / name).stat().st_mtime_ns == time for name, time in before.items())
    # another simulation: its frames replace these where that is asked for
    another = [*command, "--set", "seed=9", "--checkpoint-every", "1"]
    assert main(another) == 2
    assert "scenario.seed" in capsys.readouterr().err and len(names(out)) == 6
    assert main([*another, "--replace"]) == 0
    assert len(names(out)) == 4


def test_a_dry_run_writes_nothing(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(scenario), "--out", str(tmp_path / "out"), "--dry-run"]) == 0
    assert "nothing was written" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--set", "lattice_speed=9"], "lattice_speed"),
        (["--set", "inlets.0.radius_m=0.01"], "1.5 velocity cells"),
        (["--device", "tpu"], "tpu"),
    ],
)
def test_bad_input_is_told_in_one_line(
    arguments: list[str], told: str, scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(scenario), "--out", str(tmp_path / "out"), *arguments]) == 2
    assert told in capsys.readouterr().err


def test_a_flow_that_blows_up_names_the_checkpoint(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wild = [
        "viscosity_m2_s=0.0",
        "flow={model: bgk, smagorinsky: 0.0}",
        "lattice_speed=0.2",
        "frames=400",
        "inlets.0.turbulence=0",
    ]
    settings = [part for text in wild for part in ("--set", text)]
    assert main([str(scenario), "--out", str(tmp_path / "out"), *settings]) == 2
    message = capsys.readouterr().err
    assert "blew up at lattice step" in message and CHECKPOINT in message
