"""Helpers of the generation tests: run the command, copy a finished dataset, compare two of them."""

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from sixway.core.store import sha256_file
from sixway.data.manifest import read_manifest
from sixway.generation.command import STAGES, main


@pytest.fixture
def generate(tiny_dataset: Any) -> Callable[..., int]:
    """Run the command on the tiny config, in this process; its exit status."""

    def run(out: Path, *more: str, only: Sequence[str] = STAGES, config: Path | None = None) -> int:
        options = ["--out", str(out), "--no-estimate"] + ([] if "--workers" in more else ["--workers", "1"])
        return main([str(config or tiny_dataset.config), *options, *more], only=only)

    return run


@pytest.fixture
def own_copy(tiny_dataset: Any, tmp_path: Path) -> Path:
    """The finished dataset, to be damaged."""
    shutil.copytree(tiny_dataset.folder, tmp_path / "data")
    return tmp_path / "data"


@pytest.fixture
def contents() -> Callable[[Path], dict[str, str]]:
    """What a finished dataset holds: hashes of its densities and of every packed layer, by name.

    EXR headers name the commit, so pixels are compared by way of the packed arrays.
    """

    def read(folder: Path) -> dict[str, str]:
        found = {str(path.relative_to(folder)): sha256_file(path) for path in folder.rglob("frame_*.npz")}
        for group in read_manifest(folder).groups:
            found |= {f"{group.split} {layer}": sha256_file(folder / a.path) for layer, a in group.arrays.items()}
        return found

    return read


@pytest.fixture
def written() -> Callable[[Path], dict[str, tuple[int, int]]]:
    """Modification time and inode of every frame and packed array: both change when a file is made again."""

    def read(folder: Path) -> dict[str, tuple[int, int]]:
        files = [p for p in folder.rglob("*") if p.suffix in (".npz", ".exr", ".npy")]
        return {str(p.relative_to(folder)): (os.stat(p).st_mtime_ns, os.stat(p).st_ino) for p in files}

    return read
