"""The net: a guide picture to eight lightmap channels, as a correction to what the guide already shows."""

from functools import partial
from typing import Annotated

import torch
from jaxtyping import Float
from pydantic import Field
from torch import Tensor, nn

from sixway.core.config import Config
from sixway.core.conventions import ADAPTER_PAIRS, LIGHTMAP_CHANNELS
from sixway.models.adapter import ChannelAdapter
from sixway.models.conditioning import GuideConditioning
from sixway.models.cost import adapter_macs
from sixway.models.nafblock import share_of_smoke
from sixway.models.trunk import Trunk

Width = Annotated[int, Field(ge=1)]


class UNetConfig(Config):
    """Size of the net.

    widths: channels at 1/2, 1/4, ... of the resolution, the last at the bottleneck; pictures are
    padded to a multiple of 2^len(widths). adapter_width, adapter_blocks: channels and NAFBlocks of
    each of the four channel adapters, which run at half resolution. adapters: False puts one head for all
    eight channels there, as wide as the four cost together (the paper's ablation).
    """

    widths: Annotated[tuple[Width, ...], Field(min_length=2, max_length=8)] = (16, 24, 32, 48)
    adapter_width: Width = 16
    adapter_blocks: Annotated[int, Field(ge=0)] = 1
    adapters: bool = True


class SixWayUNet(nn.Module):
    """`unet_naf`: a U-Net with four channel adapters of NAFBlocks (seeds: neural six-way lightmaps, Fig. 3).

    guide_channels: names of the guide's channels, in order; ``transmittance`` must be among them.
    guide_scale, emissive_scale: the brightness scales of the dataset, kept in the state (`GuideConditioning`).

    Answers in the space of `models.encoding`, unclamped. A direction that the guide shows is answered
    as guide + correction, and so are alpha and emissive; the others come from the net alone. An empty
    border of whole strides changes no answer but within 4 px of where the picture ended.
    """

    def __init__(
        self,
        config: UNetConfig,
        *,
        guide_channels: tuple[str, ...],
        guide_scale: float,
        emissive_scale: float | None = None,
    ) -> None:
        super().__init__()
        guides = len(guide_channels)
        self.config = config
        self.guide_channels = guide_channels
        self.conditioning = GuideConditioning(guide_channels, scale=guide_scale, emissive_scale=emissive_scale)
        self.trunk = Trunk(guides, config.widths)
        self.guide_skip = _space_to_depth(guides)
        features = config.widths[0] + 4 * guides
        adapter_of = partial(ChannelAdapter, features, blocks=config.adapter_blocks)
        self.adapters = nn.ModuleList(
            [adapter_of(len(pair), width=config.adapter_width) for pair in _PAIRS]
            if config.adapters
            else [adapter_of(len(LIGHTMAP_CHANNELS), width=_width_of_one_head(features, config))]
        )

    @property
    def stride(self) -> int:
        """Pictures of a multiple of this many px need no padding."""
        return self.trunk.stride

    def forward(self, guide: Float[Tensor, "n g h w"]) -> Float[Tensor, "n 8 h w"]:
        """guide: any size, channels as `GuideMap` defines them. Channels out as in `LIGHTMAP_CHANNELS`."""
        # int(): a traced size becomes a constant, so no Shape operator reaches the ONNX file
        height, width = int(guide.shape[2]), int(guide.shape[3])
        conditioned = self.conditioning(guide)
        padded = self._padded(conditioned, height, width)
        correction = self._correction(padded)
        if padded is not conditioned:  # a graph traced without padding holds nothing of its size
            correction = correction[:, :, :height, :width]
        return self._shown(conditioned) + correction

    def _padded(self, conditioned: Tensor, height: int, width: int) -> Tensor:
        """Zeros to the right and below; a conditioned guide is zero where space is empty."""
        right, below = -width % self.stride, -height % self.stride
        if not right and not below:
            return conditioned
        batch, channels = int(conditioned.shape[0]), int(conditioned.shape[1])
        # joined, not padded: the exporter turns `pad` into Reshape, Transpose, Cast and a shape that it loses
        if right:
            conditioned = torch.cat([conditioned, conditioned.new_zeros(batch, channels, height, right)], dim=3)
        if below:
            conditioned = torch.cat([conditioned, conditioned.new_zeros(batch, channels, below, width + right)], dim=2)
        return conditioned

    def _correction(self, conditioned: Tensor) -> Tensor:
        place = self.guide_channels.index("transmittance")
        alpha = conditioned[:, place : place + 1]
        features = torch.cat([self.trunk(conditioned, alpha), self.guide_skip(conditioned)], dim=1)
        smoke = share_of_smoke(alpha)
        if smoke.dtype != features.dtype:  # under autocast; the exporter would write a Cast for nothing
            smoke = smoke.to(features.dtype)
        return torch.cat([adapter(features, smoke) for adapter in self.adapters], dim=1)

    def _shown(self, conditioned: Tensor) -> Tensor:
        """The lightmap as the guide shows it; zero in channels that it does not show."""
        # not zeros_like: its shape would enter the ONNX graph, or the zeros themselves as a constant
        nothing = conditioned[:, :1].clip(0.0, 0.0)
        shown_as = ["transmittance" if channel == "alpha" else channel for channel in LIGHTMAP_CHANNELS]
        places = [self.guide_channels.index(name) if name in self.guide_channels else None for name in shown_as]
        return torch.cat([nothing if i is None else conditioned[:, i : i + 1] for i in places], dim=1)


# each pair in the order of the lightmap's channels, so that the adapters' answers need no reordering
_PAIRS = sorted(
    (tuple(sorted(pair, key=LIGHTMAP_CHANNELS.index)) for pair in ADAPTER_PAIRS),
    key=lambda pair: LIGHTMAP_CHANNELS.index(pair[0]),
)
assert tuple(channel for pair in _PAIRS for channel in pair) == LIGHTMAP_CHANNELS


def _width_of_one_head(features: int, config: UNetConfig) -> int:
    """The widest that one head for all channels can be at the cost of the four adapters."""
    blocks = config.adapter_blocks
    budget = sum(adapter_macs(features, len(pair), config.adapter_width, blocks) for pair in _PAIRS)
    width = config.adapter_width
    while adapter_macs(features, len(LIGHTMAP_CHANNELS), width + 1, blocks) <= budget:
        width += 1
    return width


def _space_to_depth(channels: int) -> nn.Conv2d:
    """Every 2x2 px as four channels: the guide at half resolution, nothing lost; learnt from there on."""
    skip = nn.Conv2d(channels, 4 * channels, 2, stride=2, bias=False)
    with torch.no_grad():
        skip.weight.copy_(torch.eye(4 * channels).reshape(4 * channels, channels, 2, 2))
    return skip
