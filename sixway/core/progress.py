"""One progress bar with an ETA for every stage; plain lines where there is no terminal."""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Item = TypeVar("Item")

_SECONDS_BETWEEN_LINES = 15.0
_SECONDS_WORTH_A_LINE = 2.0


def track(items: Iterable[Item], *, total: int, label: str, start: int = 0) -> Iterator[Item]:
    """Yield `items` and show how far they are on standard error. start: units done before this run."""
    console = Console(stderr=True)
    if console.is_terminal:
        columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console) as progress:
            task = progress.add_task(label, total=total, completed=start)
            for item in items:
                yield item
                progress.advance(task)
        return
    began = told = time.monotonic()
    for done, item in enumerate(items, start=1):
        yield item
        now = time.monotonic()
        finished = start + done == total and now - began > _SECONDS_WORTH_A_LINE
        if finished or now - told >= _SECONDS_BETWEEN_LINES:
            told = now
            left = (now - began) / done * (total - start - done)
            print(f"{label}: {start + done}/{total}, {now - began:.0f} s, about {left:.0f} s left", file=sys.stderr)
