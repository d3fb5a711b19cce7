"""The numbers that the net speaks in, and the way back to linear lightmaps.

Light is scaled and sRGB-encoded: the six maps by the brightness scale of the dataset, emissive by a scale
of its own, because a fire may be a hundred times brighter than the smoke. Alpha stays linear. Losses
compare in this space, because it spreads the dark values that eyes see.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS

_ALPHA = LIGHTMAP_CHANNELS.index("alpha")


def encode_lightmap(
    linear: Float[Tensor, "n 8 h w"], *, scale: float, emissive_scale: float | None = None
) -> Float[Tensor, "n 8 h w"]:
    """Linear channels in the order of `LIGHTMAP_CHANNELS` to what the net should answer.

    emissive_scale: None for a dataset without fire, `scale` then.
    """
    maps, alpha, emissive = _split(linear)
    return torch.cat([encode_srgb(maps * scale), alpha, encode_srgb(emissive * (emissive_scale or scale))], dim=1)


def decode_lightmap(
    encoded: Float[Tensor, "n 8 h w"], *, scale: float, emissive_scale: float | None = None
) -> Float[Tensor, "n 8 h w"]:
    """What the net answered to a physical lightmap: light >= 0, linear, alpha in [0, 1]."""
    maps, alpha, emissive = _split(encoded)
    return torch.cat(
        [decode_srgb(maps) / scale, alpha.clip(0.0, 1.0), decode_srgb(emissive) / (emissive_scale or scale)], dim=1
    )


def _split(channels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    return channels[:, :_ALPHA], channels[:, _ALPHA : _ALPHA + 1], channels[:, _ALPHA + 1 :]
