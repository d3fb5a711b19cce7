"""Training state that survives a kill: written whole, the one before kept, loaded without pickles."""

import os
import sys
import zipfile
from pathlib import Path
from typing import Any

import torch

from sixway.core.store import atomic_path

LATEST = "checkpoint.pt"
PREVIOUS = "checkpoint_previous.pt"


def save_checkpoint(run_dir: Path, state: dict[str, Any]) -> None:
    """Write tensors and plain values; the last checkpoint becomes the previous one."""
    with atomic_path(run_dir / LATEST) as temporary:
        torch.save(state, temporary)
        if (run_dir / LATEST).is_file():
            os.replace(run_dir / LATEST, run_dir / PREVIOUS)


def load_checkpoint(run_dir: Path) -> dict[str, Any] | None:
    """The newest readable state, on the CPU, or None for a fresh run.

    A damaged file is told of on standard error and the previous one is used. Raises ValueError if
    files exist and none can be read: nothing is thrown away silently.
    """
    faults = []
    for path in (run_dir / LATEST, run_dir / PREVIOUS):
        if not path.is_file():
            continue
        try:
            state = _read(path)
        except Exception as error:  # zip, pickle and torch raise all kinds of errors on junk
            reason = (str(error) or type(error).__name__).splitlines()[0]
            faults.append(f"{path}: damaged checkpoint ({reason})")
            continue
        for fault in faults:
            print(f"{fault}; continuing from {path.name}, step {state['step']}", file=sys.stderr)
        return state
    if faults:
        raise ValueError("; ".join(faults) + "; delete these files to train from the start")
    return None


def _read(path: Path) -> dict[str, Any]:
    """One state; raises whatever the damage leads to."""
    with zipfile.ZipFile(path) as archive:  # torch writes checksums and does not look at them
        if (damaged := archive.testzip()) is not None:
            raise ValueError(f"the checksum of {damaged} differs")
    state = torch.load(path, map_location="cpu", weights_only=True)
    if not isinstance(state, dict) or not isinstance(state.get("step"), int):
        raise ValueError("it holds no training state")
    return state
