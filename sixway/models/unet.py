"""The net: a guide picture to eight lightmap channels, as a correction to what the guide already shows."""

from typing import Annotated

import torch
from jaxtyping import Float
from pydantic import Field
from torch import Tensor, nn

from sixway.core.config import Config
from sixway.core.conventions import ADAPTER_PAIRS, LIGHTMAP_CHANNELS
from sixway.models.adapter import ChannelAdapter
from sixway.models.conditioning import GuideConditioning
from sixway.models.trunk import Trunk

Width = Annotated[int, Field(ge=1)]


class UNetConfig(Config):
    """Size of the net.

    widths: channels at 1/2, 1/4, ... of the resolution, the last at the bottleneck; pictures are
    padded to a multiple of 2^len(widths). adapter_width, adapter_blocks: channels and NAFBlocks of
    each of the four channel adapters, which run at half resolution.
    """

    widths: Annotated[tuple[Width, ...], Field(min_length=2, max_length=8)] = (16, 24, 32, 48)
    adapter_width: Width = 16
    adapter_blocks: Annotated[int, Field(ge=0)] = 1


class SixWayUNet(nn.Module):
    """A U-Net with four channel adapters (seeds: neural six-way lightmaps, Fig. 3).

    guide_channels: names of the guide's channels, in order; ``transmittance`` must be among them.
    guide_scale: the brightness scale of the dataset, kept in the state as ``conditioning.scale``.

    Answers in the space of `models.encoding`, unclamped. A direction that the guide shows is answered
    as guide + correction, and so is alpha; the others come from the net alone.
    """

    def __init__(self, config: UNetConfig, *, guide_channels: tuple[str, ...], guide_scale: float) -> None:
        super().__init__()
        guides = len(guide_channels)
        self.config = config
        self.guide_channels = guide_channels
        self.conditioning = GuideConditioning(guide_channels, scale=guide_scale)
        self.trunk = Trunk(guides, config.widths)
        self.guide_skip = _space_to_depth(guides)
        self.adapters = nn.ModuleList(
            ChannelAdapter(config.widths[0] + 4 * guides, width=config.adapter_width, blocks=config.adapter_blocks)
            for _ in ADAPTER_PAIRS
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
        correction = self._correction(self._padded(conditioned, height, width))[:, :, :height, :width]
        return torch.cat(
            [self._answer(channel, correction, conditioned) for channel in LIGHTMAP_CHANNELS],
            dim=1,
        )

    def _padded(self, conditioned: Tensor, height: int, width: int) -> Tensor:
        """Zeros to the right and below; a conditioned guide is zero where space is empty."""
        right, below = -width % self.stride, -height % self.stride
        batch, channels = int(conditioned.shape[0]), int(conditioned.shape[1])
        # joined, not padded: the exporter turns `pad` into Reshape, Transpose, Cast and a shape that it loses
        if right:
            conditioned = torch.cat([conditioned, conditioned.new_zeros(batch, channels, height, right)], dim=3)
        if below:
            conditioned = torch.cat([conditioned, conditioned.new_zeros(batch, channels, below, width + right)], dim=2)
        return conditioned

    def _correction(self, conditioned: Tensor) -> Tensor:
        """Eight channels in the order of `ADAPTER_PAIRS`."""
        features = torch.cat([self.trunk(conditioned), self.guide_skip(conditioned)], dim=1)
        return torch.cat([adapter(features) for adapter in self.adapters], dim=1)

    def _answer(self, channel: str, correction: Tensor, conditioned: Tensor) -> Tensor:
        index = _ADAPTER_CHANNELS.index(channel)
        answer = correction[:, index : index + 1]
        shown_as = "transmittance" if channel == "alpha" else channel
        if shown_as in self.guide_channels:
            shown = self.guide_channels.index(shown_as)
            answer = answer + conditioned[:, shown : shown + 1]
        return answer


_ADAPTER_CHANNELS = tuple(channel for pair in ADAPTER_PAIRS for channel in pair)


def _space_to_depth(channels: int) -> nn.Conv2d:
    """Every 2x2 px as four channels: the guide at half resolution, nothing lost; learnt from there on."""
    skip = nn.Conv2d(channels, 4 * channels, 2, stride=2, bias=False)
    with torch.no_grad():
        skip.weight.copy_(torch.eye(4 * channels).reshape(4 * channels, channels, 2, 2))
    return skip
