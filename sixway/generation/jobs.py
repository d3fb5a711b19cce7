"""Resumable frames: a file is written whole, then recorded with its hash; what is recorded is not made again.

A stage is split into shards. One machine runs a few shards as processes (spawned: Warp and Dr.Jit do not
survive a fork); a cluster runs one shard a job with the same command.
"""

import multiprocessing
import re
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import warp as wp

from sixway.core.progress import track
from sixway.core.store import append_json_line, read_json_lines, sha256_file, write_json
from sixway.generation.plan import Folder

INDEX = "index.jsonl"
_SECONDS_BETWEEN_POLLS = 0.3


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count` of a stage's work."""

    index: int = 0
    count: int = 1

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """``I/N`` with 0 <= I < N; raises ValueError."""
        match = re.fullmatch(r"(\d+)/(\d+)", text)
        if not match or not int(match[1]) < int(match[2]):
            raise ValueError(f"shard {text!r} is not I/N with 0 <= I < N, such as 0/4")
        return cls(int(match[1]), int(match[2]))

    def of(self, items: list[Any]) -> list[Any]:
        """This shard's share; neighbours go to different shards."""
        return items[self.index :: self.count]


class FrameStore:
    """The frames in one folder, and its record of which are done. The record is read once, and again only when another
    process has added to it."""

    def __init__(self, root: Path, folder: Folder) -> None:
        self.folder = folder
        self.path = root / folder.path
        self._records: dict[str, dict[str, Any]] = {}
        self._lines = 0
        self._bytes_read = 0

    def frame_path(self, frame: int, suffix: str) -> Path:
        return self.path / f"frame_{frame:04d}{suffix}"

    def done(self) -> dict[str, dict[str, Any]]:
        """Records of finished files by name; a record whose file is gone does not count."""
        self._refresh()
        return {name: record for name, record in self._records.items() if (self.path / name).is_file()}

    def record_of(self, path: Path) -> dict[str, Any] | None:
        """The record of that file of the folder if it is finished, as `done` has it."""
        self._refresh()
        return self._records.get(path.name) if path.is_file() else None

    def holds(self, path: Path) -> bool:
        return self.record_of(path) is not None

    def times_recorded(self) -> int:
        """Records written so far, those of frames that were made twice too: grows by one with every frame."""
        self._refresh()
        return self._lines

    def record(self, path: Path, **facts: Any) -> None:
        """Record a file that `path` now holds whole."""
        described = self.path / "made_by.json"
        if not described.is_file():
            write_json(described, self.folder.made_by)
        about = {"file": path.name, "sha256": sha256_file(path), **facts}
        self._refresh()
        written = append_json_line(self.path / INDEX, about)
        if self._index_bytes() == self._bytes_read + written:  # nobody else has written
            self._take([about])
            self._bytes_read += written

    def _refresh(self) -> None:
        size = self._index_bytes()
        if size != self._bytes_read:
            self._records, self._lines = {}, 0
            self._take(read_json_lines(self.path / INDEX))
            self._bytes_read = size

    def _take(self, records: list[dict[str, Any]]) -> None:
        whole = [record for record in records if "sha256" in record]
        self._records |= {record["file"]: record for record in whole}
        self._lines += len(whole)

    def _index_bytes(self) -> int:
        try:
            return (self.path / INDEX).stat().st_size
        except FileNotFoundError:
            return 0


def run_shards(
    work: Callable[[Shard], Iterable[object]],
    *,
    label: str,
    start: int,
    total: int,
    recorded: Callable[[], int],
    workers: int,
) -> None:
    """Run a stage in `workers` processes and show how far it is. work: picklable; yields once a frame made.

    start: frames that are there already. recorded: counts the records of the stage's own folders. Raises RuntimeError
    if a worker fails; what is finished is kept.
    """
    if start >= total:
        print(f"{label}: all {total} frames are there already")
        return
    if workers == 1:
        for _ in track(work(Shard()), total=total, label=label, start=start):
            pass
        return
    before = recorded()
    context = multiprocessing.get_context("spawn")
    processes = [
        context.Process(target=_drain, args=(work, Shard(i, workers)), name=f"{label} {i}/{workers}")
        for i in range(workers)
    ]
    for process in processes:
        process.start()
    try:
        for _ in track(_watch(processes, recorded, before), total=total, label=label, start=start):
            pass
    finally:
        for process in processes:
            process.terminate()
            process.join()


def _watch(processes: list[Any], recorded: Callable[[], int], seen: int) -> Iterator[None]:
    """Yield once for every frame that appears, until all workers have ended."""
    while True:
        running = any(process.is_alive() for process in processes)
        now = recorded()
        yield from (None for _ in range(now - seen))
        seen = max(seen, now)
        failed = [process for process in processes if process.exitcode not in (None, 0)]
        if failed:
            raise RuntimeError(
                f"worker {failed[0].name} failed (its message stands above); mend the cause and run the same "
                "command again: finished frames are kept"
            )
        if not running:
            return
        time.sleep(_SECONDS_BETWEEN_POLLS)


def _drain(work: Callable[[Shard], Iterable[object]], shard: Shard) -> None:
    quieten_warp()
    for _ in work(shard):
        pass


def quieten_warp() -> None:
    """Keep Warp's greeting out of the progress; every process would print it."""
    wp.config.log_level = wp.LOG_WARNING
