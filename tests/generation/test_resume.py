"""Generation is resumed at any point: what is made stays, what is missing is made, pixels are the same."""

import errno
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sixway.core import store
from sixway.core.store import read_json_lines, sha256_file
from sixway.generation import jobs
from sixway.generation.jobs import INDEX

Contents = Callable[[Path], dict[str, str]]
Written = Callable[[Path], dict[str, tuple[int, int]]]
Generate = Callable[..., int]


def test_a_second_run_makes_nothing(own_copy: Path, generate: Generate, written: Written, capsys: Any) -> None:
    before = written(own_copy)
    assert generate(own_copy) == 0
    assert written(own_copy) == before
    assert capsys.readouterr().out.count("frames are there already") == 3


def test_a_deleted_frame_is_the_only_one_remade(own_copy: Path, generate: Generate, written: Written) -> None:
    path = sorted(own_copy.glob("target/jet/*/*/frame_0004.exr"))[1]
    digest, before = sha256_file(path), written(own_copy)
    path.unlink()
    assert generate(own_copy) == 0
    after = written(own_copy)
    assert {name for name, stamp in before.items() if after[name] != stamp} == {str(path.relative_to(own_copy))}
    assert after.keys() == before.keys()
    assert sha256_file(path) == digest


def test_a_file_that_was_never_recorded_is_made_again(own_copy: Path, generate: Generate, contents: Contents) -> None:
    """A kill between a file's last byte and its record leaves this, and half a line at worst."""
    whole = contents(own_copy)
    folder = next(own_copy.glob("guide_six/jet/*30*/*"))
    lines = (folder / INDEX).read_text().splitlines(keepends=True)
    (folder / INDEX).write_text("".join(lines[:-1]) + lines[-1][:30])
    (folder / "frame_0005.exr").write_bytes(b"not what was recorded")
    assert generate(own_copy) == 0
    assert contents(own_copy) == whole
    assert {line["file"] for line in read_json_lines(folder / INDEX)} == {f"frame_000{i}.exr" for i in (0, 1, 4, 5)}


def test_more_pairs_keep_every_frame_made(own_copy: Path, generate: Generate, written: Written) -> None:
    def frames(stamps: dict[str, tuple[int, int]]) -> dict[str, tuple[int, int]]:
        return {name: stamp for name, stamp in stamps.items() if not name.startswith("packed")}

    before = frames(written(own_copy))
    assert generate(own_copy, "pairs_per_simulation=3") == 0
    after = frames(written(own_copy))
    assert before.items() < after.items()
    assert len(after) == len(before) * 3 // 2


def test_two_shards_make_what_one_run_makes(
    tiny_dataset: Any, tmp_path: Path, generate: Generate, contents: Contents, capsys: Any
) -> None:
    out = tmp_path / "data"
    for stage in ("simulate", "march_guides", "trace_references"):
        for shard in ("1/2", "0/2"):
            assert generate(out, "--shard", shard, only=(stage,)) == 0
    told = capsys.readouterr().out
    assert "simulate: shard 1/2 made 4 frames" in told and "trace_references: shard 0/2 made 12 frames" in told
    assert generate(out, only=("pack", "verify")) == 0
    assert contents(out) == contents(tiny_dataset.folder)


_KILLED_IN_THE_THIRD_WRITE = """
import os, signal, sys
from sixway.core import store
from sixway.generation import jobs
from sixway.generation.command import main

layer, *arguments = sys.argv[1:]
replace, seen = os.replace, []

def killed(source, target):
    seen.extend([target] if f"/{layer}/" in str(target) and ".json" not in str(target) else [])
    if len(seen) == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(source, target)

store.os.replace = killed
main(arguments)
"""


@pytest.mark.parametrize(("layer", "suffix"), [("density", ".npz"), ("target", ".exr"), ("packed", ".npy")])
def test_a_killed_run_resumes_to_the_same_pixels(
    tiny_dataset: Any, tmp_path: Path, generate: Generate, contents: Contents, layer: str, suffix: str
) -> None:
    out = tmp_path / "data"
    arguments = [layer, str(tiny_dataset.config), "--out", str(out), "--workers", "1", "--no-estimate"]
    done = subprocess.run([sys.executable, "-c", _KILLED_IN_THE_THIRD_WRITE, *arguments], capture_output=True)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    assert len(list(out.glob(f"{layer}/**/[a-z]*{suffix}"))) == 2
    assert len(list(out.glob(f"{layer}/**/.part-*{suffix}"))) == 1  # it must not pass for a frame
    assert not (out / "manifest.json").exists()
    assert generate(out) == 0
    assert contents(out) == contents(tiny_dataset.folder)


def test_a_full_disk_is_told_in_one_line_and_nothing_is_lost(
    tmp_path: Path, generate: Generate, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    room = [3]

    def fsync(_: int) -> None:
        room[0] -= 1
        if room[0] < 0:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(store.os, "fsync", fsync)
    assert generate(tmp_path / "data", only=("simulate",)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "the disk is full; free space and run the same command again to resume" in line
    assert not list(tmp_path.rglob(".part-*"))
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("frame_*.npz")}
    assert len(kept) == 2  # and made_by.json
    monkeypatch.undo()
    assert generate(tmp_path / "data", only=("simulate",)) == 0
    assert len(list(tmp_path.rglob("frame_*.npz"))) == 12
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_a_dry_run_makes_nothing(tmp_path: Path, generate: Generate, capsys: Any) -> None:
    assert generate(tmp_path / "data", "--dry-run", "simulations.0.set.0=seed=77") == 0
    assert not (tmp_path / "data").exists()
    told = capsys.readouterr().out
    assert "dry run: nothing was made; 108 files are missing" in told
    assert "seed=77" in told and "Estimated cost" in told


def test_two_workers_make_what_one_makes_and_a_failed_one_is_told(
    tiny_dataset: Any, tmp_path: Path, generate: Generate, capsys: Any, written: Written
) -> None:
    out = tmp_path / "data"
    assert generate(out, "--workers", "2", only=("simulate",)) == 0
    made = {str(path.relative_to(out)): sha256_file(path) for path in out.rglob("*.npz")}
    assert made == {name: sha256_file(tiny_dataset.folder / name) for name in made} and len(made) == 12
    next(out.glob("density/jet_val/*/frame_0004.npz")).unlink()
    assert generate(out, "--workers", "2", only=("march_guides",)) == 2
    assert "failed (its message stands above); mend the cause and run the same command" in capsys.readouterr().err


def test_an_index_is_read_once_not_once_a_frame(
    own_copy: Path, generate: Generate, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[Path] = []
    read = jobs.read_json_lines
    monkeypatch.setattr(jobs, "read_json_lines", lambda path: reads.append(path) or read(path))
    for path in own_copy.glob("guide_six/jet/*/*/frame_*.exr"):
        path.unlink()
    assert generate(own_copy) == 0
    assert len(reads) > 10
    assert len(reads) == len(set(reads))


def test_a_folder_made_on_two_devices_is_told(own_copy: Path, generate: Generate, capsys: Any) -> None:
    index = next(own_copy.glob("target/jet/*/*/" + INDEX))
    lines = index.read_text().splitlines(keepends=True)
    assert '"device": "cpu"' in lines[0]
    index.write_text(lines[0].replace('"device": "cpu"', '"device": "cuda"') + "".join(lines[1:]))
    capsys.readouterr()
    assert generate(own_copy) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note:")]
    assert len(told) == 1 and "frames of 2 devices, cpu and cuda" in told[0] and str(index.parent) in told[0]
