"""Checkpoints: damaged ones are told of and passed over, and none of them runs code."""

import os
import pickle
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sixway.core import store
from sixway.training.checkpoint import LATEST, PREVIOUS, load_checkpoint, save_checkpoint


def state(step: int) -> dict[str, Any]:
    return {"step": step, "net": {"weight": torch.full((50,), float(step))}}


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    for step in (1, 2, 3):
        save_checkpoint(tmp_path, state(step))
    return tmp_path


def test_the_newest_is_read_and_the_one_before_is_kept(run_dir: Path) -> None:
    newest = load_checkpoint(run_dir)
    assert newest is not None and newest["step"] == 3
    assert torch.equal(newest["net"]["weight"], torch.full((50,), 3.0))
    assert torch.load(run_dir / PREVIOUS, weights_only=True)["step"] == 2
    assert {path.name for path in run_dir.iterdir()} == {LATEST, PREVIOUS}


def test_no_checkpoint_is_a_fresh_run(tmp_path: Path) -> None:
    assert load_checkpoint(tmp_path) is None


def test_a_damaged_one_is_told_of_and_the_one_before_is_used(run_dir: Path, capsys: Any) -> None:
    (run_dir / LATEST).write_bytes((run_dir / LATEST).read_bytes()[:-300])
    loaded = load_checkpoint(run_dir)
    assert loaded is not None and loaded["step"] == 2
    told = capsys.readouterr().err
    assert f"{run_dir / LATEST}: damaged checkpoint" in told
    assert f"continuing from {PREVIOUS}, step 2" in told


def test_two_damaged_ones_are_an_error_not_a_fresh_start(run_dir: Path) -> None:
    (run_dir / LATEST).write_bytes(b"")
    (run_dir / PREVIOUS).write_bytes(b"junk")
    with pytest.raises(ValueError, match=rf"{LATEST}: damaged.*{PREVIOUS}: damaged.*delete these files"):
        load_checkpoint(run_dir)


def test_a_kill_between_the_two_renames_loses_nothing(run_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace = os.replace

    def killed(source: Any, target: Any) -> None:
        if Path(target).name == LATEST:
            raise KeyboardInterrupt
        replace(source, target)

    monkeypatch.setattr(store.os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        save_checkpoint(run_dir, state(4))
    monkeypatch.undo()
    loaded = load_checkpoint(run_dir)
    assert loaded is not None and loaded["step"] == 3


class Malicious:
    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> Any:
        return (Path.touch, (self.trace,))


@pytest.mark.parametrize("by", ["pickle", "torch", "legacy"])
def test_a_checkpoint_cannot_run_code(run_dir: Path, tmp_path: Path, by: str, capsys: Any) -> None:
    trace = tmp_path / "executed"
    bad = {**state(9), "extra": Malicious(trace)}
    if by == "pickle":
        (run_dir / LATEST).write_bytes(pickle.dumps(bad))
    else:
        torch.save(bad, run_dir / LATEST, _use_new_zipfile_serialization=by == "torch")
    loaded = load_checkpoint(run_dir)
    assert loaded is not None and loaded["step"] == 2
    assert LATEST in capsys.readouterr().err
    (run_dir / PREVIOUS).unlink()
    with pytest.raises(ValueError, match="damaged checkpoint"):
        load_checkpoint(run_dir)
    assert not trace.exists()


@given(place=st.floats(0.0, 1.0), value=st.integers(0, 255), cut=st.booleans())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_the_damage_a_state_comes_back(
    tmp_path_factory: pytest.TempPathFactory, place: float, value: int, cut: bool
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    for step in (1, 2):
        save_checkpoint(folder, state(step))
    content = bytearray((folder / LATEST).read_bytes())
    position = min(int(place * len(content)), len(content) - 1)
    content[position] = value
    (folder / LATEST).write_bytes(content[:position] if cut else content)
    loaded = load_checkpoint(folder)
    assert loaded is not None and loaded["step"] in (1, 2)
    assert torch.equal(loaded["net"]["weight"], torch.full((50,), float(loaded["step"])))


@pytest.mark.parametrize("foreign", [torch.zeros(3), [1, 2], {"epoch": 3}, {"step": "three"}])
def test_a_foreign_file_is_no_checkpoint(run_dir: Path, foreign: Any, capsys: Any) -> None:
    torch.save(foreign, run_dir / LATEST)
    loaded = load_checkpoint(run_dir)
    assert loaded is not None and loaded["step"] == 2
    assert "damaged checkpoint" in capsys.readouterr().err
