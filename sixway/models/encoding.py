"""The numbers that the net speaks in, and the way back to linear lightmaps.

Light (six maps, emissive) is scaled by the brightness scale of the dataset and sRGB-encoded; alpha
stays linear. Losses compare in this space, because it spreads the dark values that eyes see.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS

_ALPHA = LIGHTMAP_CHANNELS.index("alpha")


def encode_lightmap(linear: Float[Tensor, "n 8 h w"], *, scale: float) -> Float[Tensor, "n 8 h w"]:
    """Linear channels in the order of `LIGHTMAP_CHANNELS` to what the net should answer."""
    light = encode_srgb(linear * scale)
    return torch.cat([light[:, :_ALPHA], linear[:, _ALPHA : _ALPHA + 1], light[:, _ALPHA + 1 :]], dim=1)


def decode_lightmap(encoded: Float[Tensor, "n 8 h w"], *, scale: float) -> Float[Tensor, "n 8 h w"]:
    """What the net answered to a physical lightmap: light >= 0, linear, alpha in [0, 1]."""
    light = decode_srgb(encoded) / scale
    alpha = encoded[:, _ALPHA : _ALPHA + 1].clip(0.0, 1.0)
    return torch.cat([light[:, :_ALPHA], alpha, light[:, _ALPHA + 1 :]], dim=1)
