"""A training run that is asked to stop: its step is finished and saved, and the same command goes on from there."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

EXIT_STATUS = 130
"""Of a command that was interrupted, as shells have it for SIGINT."""


class Interrupted(RuntimeError):
    """The run was asked to stop; its state is saved."""


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """Collects SIGINT and SIGTERM into a list while the block runs; a step in hand is finished first."""
    caught: list[int] = []
    handlers = {
        number: signal.signal(number, lambda n, _: caught.append(n)) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield caught
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
