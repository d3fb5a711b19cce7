"""The learning rate and the averaging, at their ends and in between."""

import numpy as np
import pytest

from sixway.training.schedule import ema_decay, learning_rate


def test_the_rate_starts_low_peaks_after_the_warm_up_and_ends_near_zero() -> None:
    rates = [learning_rate(step, steps=100, peak=2.0, warmup_steps=10) for step in range(100)]
    assert rates[0] == pytest.approx(0.2)
    assert rates[9] == rates[10] == pytest.approx(2.0)
    assert rates[55] == pytest.approx(1.0)  # half way down the cosine
    assert 0.0 < rates[-1] < 1e-3 * 2.0
    assert np.all(np.diff(rates[:10]) > 0) and np.all(np.diff(rates[10:]) < 0)


@pytest.mark.parametrize("steps", [1, 5, 10])
def test_a_run_shorter_than_its_warm_up_still_has_a_rate(steps: int) -> None:
    rates = [learning_rate(step, steps=steps, peak=1.0, warmup_steps=10) for step in range(steps)]
    assert all(0.0 < rate <= 1.0 for rate in rates)


def test_the_average_soon_forgets_the_random_start() -> None:
    forgotten = np.prod([ema_decay(step, decay=0.999) for step in range(100)])
    assert forgotten < 1e-6  # 0.999^100 alone would keep 90 % of it
    assert ema_decay(10**6, decay=0.999) == 0.999
    assert ema_decay(0, decay=0.0) == 0.0
