"""Squared error of pixels, with channels weighted and pixels left out on request."""

from jaxtyping import Float
from torch import Tensor


def masked_mse(
    predicted: Float[Tensor, "n c h w"],
    target: Float[Tensor, "n c h w"],
    *,
    channel_weights: Float[Tensor, " c"],
    mask: Float[Tensor, "n 1 h w"] | None = None,
) -> Float[Tensor, ""]:
    """Weighted mean of the channels' mean squared errors.

    A channel of weight 0 has no part in the loss, whatever it holds, NaN excepted. mask: how much each
    pixel counts, in [0, 1]. Where nothing counts at all, the loss is 0.
    """
    squared = (predicted - target).square()
    if mask is None:
        per_channel = squared.mean(dim=(0, 2, 3))
    else:
        per_channel = (squared * mask).sum(dim=(0, 2, 3)) / mask.sum().clamp_min(1.0)
    # the clamps keep 0 / 0 out: a batch may be masked as a whole
    return (per_channel * channel_weights).sum() / channel_weights.sum().clamp_min(1e-12)
