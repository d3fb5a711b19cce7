"""metrics.jsonl: one line a logged step; a resumed run continues it without doubled steps. TensorBoard beside it."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from sixway.core.store import append_json_line, read_json_lines, write_text

METRICS = "metrics.jsonl"
TENSORBOARD = "tensorboard"


class MetricsLog:
    """Appends to `run_dir/metrics.jsonl`; lines at or after `from_step` are dropped first.

    tensorboard: write the same numbers to `run_dir/tensorboard`; raises ValueError if it is not installed.
    """

    def __init__(self, run_dir: Path, *, from_step: int, tensorboard: bool = False) -> None:
        self._board = _open_board(run_dir / TENSORBOARD, from_step) if tensorboard else None
        self.path = run_dir / METRICS
        kept = [line for line in read_json_lines(self.path) if line["step"] < from_step]
        write_text(self.path, "".join(json.dumps(line) + "\n" for line in kept))

    def write(self, step: int, **values: float) -> None:
        append_json_line(self.path, {"step": step, **values})
        if self._board:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)

    def show(self, step: int, name: str, pixels: np.ndarray) -> None:
        """A picture [h, w, 3] of bytes, for TensorBoard alone."""
        if self._board:
            self._board.add_image(name, pixels, step, dataformats="HWC")

    def close(self) -> None:
        if self._board:
            self._board.close()


def _open_board(folder: Path, from_step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise ValueError(
            "train.tensorboard: true needs TensorBoard, which is not installed; "
            "run: pip install 'sixway[tracking]', or set train.tensorboard: false"
        ) from error
    return SummaryWriter(str(folder), purge_step=from_step)
