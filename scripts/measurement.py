"""How every script that measures reports: rows with bounds, a table, JSON, a summary line, exit 1 on a miss."""

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from sixway.core.store import provenance, write_json, write_text


def parser(description: str) -> argparse.ArgumentParser:
    """The options that all of them share."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("--json", type=Path, help="write the rows to this file")
    options.add_argument("--quick", action="store_true", help="small sizes, under a minute")
    return options


@dataclass
class Measurement:
    """Rows of one script. config: what was measured, in plain values."""

    config: dict[str, Any]
    repetitions: int
    rows: list[dict[str, Any]] = field(default_factory=list)
    started: float = field(default_factory=time.perf_counter)

    def add(
        self, name: str, value: float, unit: str, *, at_most: float | None = None, at_least: float | None = None
    ) -> None:
        """One row; `at_most` or `at_least` is its bound, without one the row only tells."""
        value = float(value)  # JSON knows no NumPy numbers
        ok = (at_most is None or value <= at_most) and (at_least is None or value >= at_least)
        bound = f"<= {at_most:g}" if at_most is not None else f">= {at_least:g}" if at_least is not None else ""
        self.rows.append({"name": name, "value": value, "unit": unit, "bound": bound, "ok": ok})

    def finish(self, json_path: Path | None) -> int:
        """Print the table and the summary line, write the JSON; the exit status."""
        table = Table("name", "value", "unit", "bound", "ok")
        for row in self.rows:
            ok = "ok" if row["ok"] else "MISSED"
            table.add_row(row["name"], f"{row['value']:.4g}", row["unit"], row["bound"], ok)
        Console(width=None if sys.stdout.isatty() else 120).print(table)
        made = provenance()
        if json_path:
            about = {
                "commit": made["commit"],
                "hardware": made["hardware"],
                "config": self.config,
                "repetitions": self.repetitions,
                "seconds": time.perf_counter() - self.started,
            }
            rows = [row | ({"value": None} if math.isnan(row["value"]) else {}) for row in self.rows]
            write_json(json_path, {"rows": rows, **about})
        missed = [row["name"] for row in self.rows if not row["ok"]]
        names = f": {', '.join(missed)}" if missed else ""
        print(f"{len(self.rows)} rows, {len(missed)} missed{names}; {json.dumps(self.config)}")
        return 1 if missed else 0


def median_seconds(work: Callable[[], object], *, repetitions: int, wait: Callable[[], None]) -> float:
    """Median time of `work` after one run that is not counted; `wait` blocks until the device is done."""
    work()
    wait()
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        work()
        wait()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def write_section(path: Path, name: str, text: str) -> None:
    """Put `text` between the lines `<!-- name:begin -->` and `<!-- name:end -->` of a Markdown file.

    A file without them gets them at its end. ValueError if only one is there.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    page = path.read_text(encoding="utf-8") if path.exists() else ""
    if begin not in page and end not in page:
        page = f"{page.rstrip()}\n\n{begin}\n{end}\n".lstrip()
    if page.count(begin) != 1 or page.count(end) != 1 or page.index(begin) > page.index(end):
        raise ValueError(f"{path}: {begin} and {end} must each stand there once, in this order; mend the file")
    before, after = page.partition(begin)[0], page.partition(end)[2]
    write_text(path, f"{before}{begin}\n{text.strip()}\n{end}{after}")
