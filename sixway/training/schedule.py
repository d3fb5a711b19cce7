"""The learning rate: a linear warm-up, then half a cosine down to zero."""

import math


def learning_rate(step: int, *, steps: int, peak: float, warmup_steps: int) -> float:
    """Rate of step `step` in [0, steps) (Loshchilov and Hutter 2017, Eq. 5, without restarts)."""
    if step < warmup_steps:
        return peak * (step + 1) / warmup_steps
    progress = (step - warmup_steps) / max(1, steps - warmup_steps)
    return 0.5 * peak * (1.0 + math.cos(math.pi * progress))


def ema_decay(step: int, *, decay: float) -> float:
    """Decay of the averaged weights: short in the first steps, so that the random start is soon forgotten."""
    return min(decay, (1.0 + step) / (10.0 + step))
