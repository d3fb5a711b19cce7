"""Reading ahead changes when a batch is read, not what it holds."""

import threading

import pytest

from sixway.training.prefetch import prefetch


def test_every_step_gets_its_own_item_in_order() -> None:
    assert list(prefetch(lambda step: step * step, range(3, 7))) == [(3, 9), (4, 16), (5, 25), (6, 36)]
    assert list(prefetch(lambda step: step, range(0))) == []


def test_the_next_item_is_read_while_this_one_is_used() -> None:
    begun = {step: threading.Event() for step in range(3)}

    def read(step: int) -> int:
        begun[step].set()
        return step

    for step, _ in prefetch(read, range(3)):
        if step < 2:
            assert begun[step + 1].wait(timeout=10.0)


def test_what_goes_wrong_is_raised_at_its_step() -> None:
    def read(step: int) -> int:
        if step == 2:
            raise ValueError("step 2 cannot be read")
        return step

    seen = []
    with pytest.raises(ValueError, match="step 2 cannot be read"):
        for step, _ in prefetch(read, range(5)):
            seen.append(step)
    assert seen == [0, 1]
