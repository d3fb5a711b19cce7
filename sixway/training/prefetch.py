"""The next batch is read while the device works on this one."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")


def prefetch(read: Callable[[int], Item], steps: range) -> Iterator[tuple[int, Item]]:
    """Every step and `read(step)`, one step ahead in a thread of its own.

    `read` must be a function of the step alone, so that being early changes nothing. What it raises is
    raised here, at its step.
    """
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="prefetch") as reader:
        if not steps:
            return
        coming = reader.submit(read, steps[0])
        for step in steps:
            item = coming.result()
            if step + steps.step in steps:
                coming = reader.submit(read, step + steps.step)
            yield step, item
