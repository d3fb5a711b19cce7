"""How a guide picture enters the net: every channel near [0, 1], and zero where there is no smoke."""

import math
from itertools import groupby

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS

_LIGHT_CHANNELS = ("in_scatter", *DIRECTIONS)
_KNOWN_CHANNELS = (*_LIGHT_CHANNELS, "transmittance", "depth", "emissive")


class GuideConditioning(nn.Module):
    """Light is scaled and sRGB-encoded, transmittance becomes alpha, depth stays as it is.

    channels: names of the guide's channels, in order. scale: the brightness scale of the dataset;
    emissive_scale: that of its fire (None: `scale`). Both are buffers, so a checkpoint carries them.
    Raises ValueError for unknown or repeated channels, no transmittance, or a scale that is not positive.
    """

    scale: Tensor
    emissive_scale: Tensor

    def __init__(self, channels: tuple[str, ...], *, scale: float, emissive_scale: float | None = None) -> None:
        super().__init__()
        unknown = [name for name in channels if name not in _KNOWN_CHANNELS]
        if unknown:
            raise ValueError(f"guide channels {unknown} are unknown to the net; it reads {_KNOWN_CHANNELS}")
        if len(set(channels)) != len(channels):
            raise ValueError(f"guide channels {channels} name one twice")
        if "transmittance" not in channels:
            raise ValueError(f"guide channels {channels} lack transmittance, from which the net corrects alpha")
        scales = {"scale": scale, "emissive_scale": scale if emissive_scale is None else emissive_scale}
        self.channels = channels
        for name, value in scales.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} {value} of the guide must be positive and finite")
            self.register_buffer(name, torch.tensor(value, dtype=torch.float32))

    def forward(self, guide: Float[Tensor, "n g h w"]) -> Float[Tensor, "n g h w"]:
        if guide.shape[1] != len(self.channels):
            raise ValueError(f"the guide has {guide.shape[1]} channels, this net reads {self.channels}")
        parts, start = [], 0
        # neighbours of one kind go together: fewer nodes in the exported graph
        for kind, names in groupby(self.channels, key=_kind):
            stop = start + len(list(names))
            parts.append(self._conditioned(kind, guide[:, start:stop]))
            start = stop
        return torch.cat(parts, dim=1)

    def _conditioned(self, kind: str, values: Tensor) -> Tensor:
        match kind:
            case "light":
                return encode_srgb(values * self.scale)
            case "emissive":
                return encode_srgb(values * self.emissive_scale)
            case "transmittance":
                return 1.0 - values
            case _:
                return values


def _kind(channel: str) -> str:
    return "light" if channel in _LIGHT_CHANNELS else channel
