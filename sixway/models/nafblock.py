"""NAFBlock: a residual block without activation functions (Chen et al. 2022, Fig. 3).

Everything is written with operators that the legacy exporter keeps plain at ONNX opset 15: a layer
norm from its formula, slices at constant places instead of `chunk`.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class ChannelNorm(nn.Module):
    """Layer norm over the channels of each pixel, with a learnt scale and shift (Ba et al. 2016).

    Written out, because the LayerNormalization operator needs opset 17.
    """

    def __init__(self, channels: int, epsilon: float = 1e-6) -> None:
        super().__init__()
        self.epsilon = epsilon
        self.weight = nn.Parameter(torch.ones(1, channels, 1, 1))
        self.bias = nn.Parameter(torch.zeros(1, channels, 1, 1))

    def forward(self, features: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c h w"]:
        centred = features - features.mean(dim=1, keepdim=True)
        variance = (centred * centred).mean(dim=1, keepdim=True)
        return centred / torch.sqrt(variance + self.epsilon) * self.weight + self.bias


def simple_gate(features: Float[Tensor, "n c2 h w"], channels: int) -> Float[Tensor, "n c h w"]:
    """The first `channels` channels times the other half (SimpleGate, Chen et al. 2022)."""
    return features[:, :channels] * features[:, channels:]


class NAFBlock(nn.Module):
    """Maps [n, channels, h, w] to the same shape; the identity when new, as beta and gamma begin at zero.

    The channel attention takes a mean over the whole picture, so the block is not strictly local: its
    answer depends a little on the size of the picture and on how much of it is empty.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels
        self.norm_spatial = ChannelNorm(channels)
        self.widen = nn.Conv2d(channels, 2 * channels, 1)
        self.depthwise = nn.Conv2d(2 * channels, 2 * channels, 3, padding=1, groups=2 * channels)
        self.attention = nn.Conv2d(channels, channels, 1)
        self.merge = nn.Conv2d(channels, channels, 1)
        self.beta = nn.Parameter(torch.zeros(1, channels, 1, 1))

        self.norm_pointwise = ChannelNorm(channels)
        self.expand = nn.Conv2d(channels, 2 * channels, 1)
        self.contract = nn.Conv2d(channels, channels, 1)
        self.gamma = nn.Parameter(torch.zeros(1, channels, 1, 1))

        for convolution in (self.widen, self.depthwise, self.attention, self.merge, self.expand, self.contract):
            nn.init.kaiming_normal_(convolution.weight, nonlinearity="linear")
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]
        # attention near one lets the first steps train the rest of the block
        nn.init.ones_(self.attention.bias)  # type: ignore[arg-type]

    def forward(self, features: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c h w"]:
        gated = simple_gate(self.depthwise(self.widen(self.norm_spatial(features))), self.channels)
        attended = gated * self.attention(gated.mean(dim=(2, 3), keepdim=True))
        features = features + self.beta * self.merge(attended)

        gated = simple_gate(self.expand(self.norm_pointwise(features)), self.channels)
        return features + self.gamma * self.contract(gated)
