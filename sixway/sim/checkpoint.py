"""The state of a simulation on disk, so that a killed run goes on and ends with the same bytes."""

import json
import zipfile
from pathlib import Path

import numpy as np

from sixway.core.store import atomic_path, content_hash
from sixway.sim.solver import SmokeSolver

_ABOUT = "about"


def save_checkpoint(path: Path, solver: SmokeSolver) -> None:
    """Write the whole state atomically, uncompressed; the file before it stays until this one is whole."""
    about = {"scenario": content_hash(solver.scenario.identity()), "frame": solver.frames_done}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **{_ABOUT: np.array(json.dumps(about)), **solver.state()})  # type: ignore[arg-type]


def load_checkpoint(path: Path, solver: SmokeSolver) -> None:
    """Put `solver` where the file's was. Raises ValueError for a damaged file or one of another scenario."""
    try:
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(str(file[_ABOUT]))
            state = {name: file[name] for name in file.files if name != _ABOUT}
        scenario = about["scenario"]
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"{path}: not a readable checkpoint ({error}); delete it to start from the beginning"
        ) from error
    if scenario != content_hash(solver.scenario.identity()):
        raise ValueError(
            f"{path}: belongs to another scenario or other settings; delete it to start from the beginning"
        )
    solver.restore(state)
