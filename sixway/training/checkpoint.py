"""Training state that survives a kill: written whole, the one before kept, loaded without pickles."""

import os
import pickle
import sys
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


def load_checkpoint(run_dir: Path, *, device: str) -> dict[str, Any] | None:
    """The newest readable state, or None for a fresh run.

    A damaged file is told of on standard error and the previous one is used. Raises ValueError if
    files exist and none can be read: nothing is thrown away silently.
    """
    faults = []
    for path in (run_dir / LATEST, run_dir / PREVIOUS):
        if not path.is_file():
            continue
        try:
            state: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
        except (RuntimeError, EOFError, OSError, pickle.UnpicklingError, ValueError) as error:
            faults.append(f"{path}: damaged checkpoint ({str(error).splitlines()[0]})")
            continue
        for fault in faults:
            print(f"{fault}; continuing from {path.name}, step {state['step']}", file=sys.stderr)
        return state
    if faults:
        raise ValueError("; ".join(faults) + "; delete these files to train from the start")
    return None
