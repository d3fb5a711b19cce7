"""metrics.jsonl: one line a logged step; a resumed run continues it without doubled steps."""

import json
from pathlib import Path
from typing import Any

from sixway.core.store import append_json_line, read_json_lines, write_text

METRICS = "metrics.jsonl"


class MetricsLog:
    """Appends to `run_dir/metrics.jsonl`; lines at or after `from_step` are dropped first."""

    def __init__(self, run_dir: Path, *, from_step: int) -> None:
        self.path = run_dir / METRICS
        kept = [line for line in read_json_lines(self.path) if line["step"] < from_step]
        write_text(self.path, "".join(json.dumps(line) + "\n" for line in kept))

    def write(self, step: int, **values: Any) -> None:
        append_json_line(self.path, {"step": step, **values})
