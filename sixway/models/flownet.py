"""Optical flow by a small net: feature pyramids, warping, cost volumes (PWC-Net; Sun et al. 2018).

From the coarsest level to half the size of the picture, each level warps the second picture's features by the flow so
far, compares them with the first's at all small shifts, and adds what is left of the motion.
"""

from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from kornia.filters import gaussian_blur2d
from pydantic import Field
from torch import Tensor, nn
from torch.nn import functional

from sixway.core.config import Config
from sixway.models.flow_warp import resized_flow, warp
from sixway.models.weights import load_with_card, save_with_card

WEIGHTS = "flownet.safetensors"
CARD = "flownet.json"
SHIPPED = Path(__file__).parents[1] / "zoo" / "flow"

_DARKEST = 1e-3
"""Pictures dimmer than this (sRGB code) are not brightened any further."""

_FINE_DETAIL_GAIN = 4.0

_HIDDEN = 32
"""Channels that a level hands to the next beside the flow."""


class FlowNetConfig(Config):
    """Sizes of the net, from the finest level (half the picture) to the coarsest."""

    features: tuple[int, ...] = Field(default=(16, 32, 64, 96), min_length=1)
    decoders: tuple[int, ...] = Field(default=(32, 64, 96, 96), min_length=1)
    """Widths of each level's first two convolutions."""
    reaches_px: tuple[int, ...] = Field(default=(1, 2, 3, 2), min_length=1)
    """Shifts that each cost volume compares, in the level's own pixels."""


class FlowNet(nn.Module):
    """How far every pixel of one picture has gone in the next. Any size from 16 x 16 px.

    Brightness does not matter: a pair is scaled by its own. Pictures without smoke have no flow to find, and what the
    net answers there means nothing.
    """

    name = "flownet"

    def __init__(self, config: FlowNetConfig | None = None, *, pretrained: bool = False) -> None:
        super().__init__()
        self.config = config = config or FlowNetConfig()
        self.pretrained = pretrained
        depths = {len(config.features), len(config.decoders), len(config.reaches_px)}
        if len(depths) > 1:
            raise ValueError(f"{config} counts its levels in {len(depths)} ways; give all three tuples one length")
        below = (2, *config.features[:-1])
        self.encoders = nn.ModuleList(map(_encoder, below, config.features))
        coarsest = len(config.features) - 1
        self.decoders = nn.ModuleList(
            FlowDecoder(features, width, reach, is_coarsest=level == coarsest)
            for level, (features, width, reach) in enumerate(
                zip(config.features, config.decoders, config.reaches_px, strict=True)
            )
        )

    def forward(self, first: Float[Tensor, "n 1 h w"], second: Float[Tensor, "n 1 h w"]) -> Float[Tensor, "n 2 h w"]:
        """Flow [px; right, down] on the pixels of `first`: second(x + flow) is close to first(x). sRGB code."""
        return self.pyramid(first, second)[-1]

    def pyramid(self, first: Float[Tensor, "n 1 h w"], second: Float[Tensor, "n 1 h w"]) -> list[Tensor]:
        """The flow after every level, coarsest first, each brought to the pictures' size [px of the picture]."""
        height, width = first.shape[2:]
        # fp32: what is left of the motion shows in small differences of features
        with torch.autocast(first.device.type, enabled=False):
            pair = _prepared(torch.cat([first.float(), second.float()]), multiple=2 ** len(self.encoders))
            levels = []
            for encode in self.encoders:
                pair = encode(pair)
                levels.append(pair.chunk(2))
            flow: Tensor | None = None
            hidden: Tensor | None = None
            flows: list[Tensor] = []
            for decode, (one, two) in zip(reversed(self.decoders), reversed(levels), strict=True):
                flow, hidden = decode(one, two, flow, hidden)
                scale = 2 ** (len(self.encoders) - len(flows))
                size = {"height": scale * one.shape[2], "width": scale * one.shape[3]}
                flows.append(resized_flow(flow, **size)[:, :, :height, :width])
        return flows


class FlowDecoder(nn.Module):
    """One level: the flow of the level below made finer."""

    def __init__(self, features: int, width: int, reach_px: int, *, is_coarsest: bool) -> None:
        super().__init__()
        self.reach_px = reach_px
        shifts = (2 * reach_px + 1) ** 2
        from_below = 0 if is_coarsest else 2 + _HIDDEN
        self.layers = nn.Sequential(
            *_convolution(shifts + 2 * features + from_below, width),
            *_convolution(width, width),
            *_convolution(width, _HIDDEN),
        )
        self.to_flow = nn.Conv2d(_HIDDEN, 2, 3, padding=1)
        nn.init.normal_(self.to_flow.weight, std=1e-3)
        nn.init.zeros_(self.to_flow.bias)  # type: ignore[arg-type]

    def forward(self, one: Tensor, two: Tensor, flow: Tensor | None, hidden: Tensor | None) -> tuple[Tensor, Tensor]:
        """The flow in this level's pixels, and what the next level may know of how it was found."""
        below = []
        if flow is not None and hidden is not None:
            flow = resized_flow(flow, height=one.shape[2], width=one.shape[3])
            two = warp(two, flow)
            below = [flow, functional.interpolate(hidden, size=one.shape[2:], mode="bilinear", align_corners=False)]
        hidden = self.layers(torch.cat([cost_volume(one, two, reach_px=self.reach_px), one, two - one, *below], dim=1))
        step = self.to_flow(hidden)
        return (step if flow is None else flow + step), hidden


def cost_volume(
    one: Float[Tensor, "n c h w"], two: Float[Tensor, "n c h w"], *, reach_px: int
) -> Float[Tensor, "n s h w"]:
    """Cosine between features of `one` and of `two` at every shift of up to `reach_px` each way; in [-1, 1]."""
    one, two = (functional.normalize(features, dim=1, eps=1e-3) for features in (one, two))
    height, width = one.shape[2:]
    padded = functional.pad(two, [reach_px] * 4)
    side = range(2 * reach_px + 1)
    return torch.stack([(one * padded[:, :, y : y + height, x : x + width]).sum(1) for y in side for x in side], dim=1)


def _prepared(pictures: Tensor, *, multiple: int) -> Tensor:
    """Pairs [2n, 1, h, w] scaled by their own brightness, with a channel of fine detail, padded to whole levels."""
    pairs = torch.stack(pictures.chunk(2))
    power = pairs.square()
    # the mean square weighted by itself: how much of the picture is empty does not matter
    bright = power.square().sum(dim=(0, 2, 3, 4)) / (power.sum(dim=(0, 2, 3, 4)) + _DARKEST**2)
    scale = (bright + _DARKEST**2).rsqrt().reshape(1, -1, 1, 1, 1)
    scaled = (pairs * scale).flatten(0, 1)
    height, width = scaled.shape[2:]
    padding = [0, -width % multiple, 0, -height % multiple]
    scaled = functional.pad(scaled, padding, mode="replicate")
    detail = scaled - gaussian_blur2d(scaled, 9, (2.0, 2.0), border_type="replicate")
    return torch.cat([scaled, _FINE_DETAIL_GAIN * detail], dim=1)


def _encoder(channels: int, features: int) -> nn.Sequential:
    return nn.Sequential(*_convolution(channels, features, stride=2), *_convolution(features, features))


def _convolution(channels: int, features: int, *, stride: int = 1) -> tuple[nn.Module, nn.Module]:
    convolution = nn.Conv2d(channels, features, 3, stride=stride, padding=1)
    nn.init.kaiming_normal_(convolution.weight, a=0.1)
    nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]
    return convolution, nn.LeakyReLU(0.1)


class FlowCard(Config):
    """What stands beside the weights. data: hash of the clips. scores: endpoint errors on validation smoke [px]."""

    format: Literal[1] = 1
    net: FlowNetConfig
    steps: int
    data: str
    size_px: int
    scores: dict[str, float]
    provenance: dict[str, str]
    licence: str = "Apache-2.0, as sixway; trained on pictures of sixway's own simulations alone"
    weights_sha256: str = ""


def save_flownet(folder: Path, net: FlowNet, card: FlowCard) -> None:
    """Write weights and card, each whole; the card holds the hash of the weights."""
    save_with_card(net, card, weights=folder / WEIGHTS, card_path=folder / CARD)


def load_flownet(folder: Path = SHIPPED) -> FlowNet:
    """The trained net, frozen: its answers are differentiable in the pictures, its weights are constants.

    Raises FileNotFoundError if there is none, ValueError if weights and card do not belong together.
    """
    net, _ = load_with_card(
        FlowCard,
        lambda card: FlowNet(card.net, pretrained=True),
        weights=folder / WEIGHTS,
        card_path=folder / CARD,
        kind="FlowNet",
        made_by="python -m sixway.train_flow configs/train/flow.yaml",
    )
    return net.requires_grad_(False)
