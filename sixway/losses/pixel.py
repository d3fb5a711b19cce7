"""Squared error of pixels, with channels weighted and pixels left out on request."""

import torch
from jaxtyping import Float
from torch import Tensor

from sixway.core.color import decode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS

_ALPHA = LIGHTMAP_CHANNELS.index("alpha")
_TOE = 12.92
"""Slope of the sRGB curve at 0 (IEC 61966-2-1)."""


def linear_light(encoded: Float[Tensor, "n 8 h w"]) -> Float[Tensor, "n 8 h w"]:
    """sRGB-encoded light to linear light, in units of the brightness scale that it was encoded with; alpha as it is.

    The curve goes on below 0 with the slope that it has there, so that a negative answer has a gradient.
    """
    light = decode_srgb(encoded.clamp_min(0.0)) + encoded.clamp_max(0.0) / _TOE
    return torch.cat([light[:, :_ALPHA], encoded[:, _ALPHA : _ALPHA + 1], light[:, _ALPHA + 1 :]], dim=1)


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
