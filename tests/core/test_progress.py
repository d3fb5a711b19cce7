"""Progress: everything passes through, and logs stay short where there is no terminal."""

from collections.abc import Iterator

import pytest

from sixway.core import progress
from sixway.core.progress import track


class Clock:
    """Seconds that pass only as told."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress.time, "monotonic", clock.monotonic)
    return clock


def taking(clock: Clock, seconds: float, count: int) -> Iterator[int]:
    for number in range(count):
        clock.now += seconds
        yield number


def test_items_pass_unchanged_and_lazily(capsys: pytest.CaptureFixture[str]) -> None:
    drawn = []

    def items() -> Iterator[int]:
        for number in range(3):
            drawn.append(number)
            yield number

    tracked = track(items(), total=3, label="x")
    assert drawn == []
    assert next(tracked) == 0 and drawn == [0]
    assert list(tracked) == [1, 2]
    assert list(track([], total=0, label="x")) == []
    assert capsys.readouterr() == ("", "")  # quick work says nothing, and never on standard output


def test_a_long_stage_tells_how_far_it_is(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    assert list(track(taking(clock, 10.0, 6), total=6, label="march")) == list(range(6))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "march: 2/6, 20 s, about 40 s left",
        "march: 4/6, 40 s, about 20 s left",
        "march: 6/6, 60 s, about 0 s left",
    ]


def test_a_resumed_stage_counts_what_was_done_before(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    """Ten of twelve were there: the time left is judged by this run's pace alone."""
    list(track(taking(clock, 20.0, 2), total=12, label="trace", start=10))
    assert capsys.readouterr().err.splitlines() == [
        "trace: 11/12, 20 s, about 20 s left",
        "trace: 12/12, 40 s, about 0 s left",
    ]
