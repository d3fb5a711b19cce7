"""NAFBlock: a residual block without activation functions (Chen et al. 2022, Fig. 3), for pictures partly empty.

The legacy exporter, which alone writes opset 15, needs plain operators: while it traces, layer norm is
written from its formula and the gate as slices at constant places (`chunk` would ask for the shape).
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional


class ChannelNorm(nn.Module):
    """Layer norm over the channels of each pixel (Ba et al. 2016).

    It has no scale and shift of its own: the 1x1 convolution behind it learns both.
    """

    def __init__(self, epsilon: float = 1e-6) -> None:
        super().__init__()
        self.epsilon = epsilon

    def forward(self, features: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c h w"]:
        if torch.jit.is_tracing():
            centred = features - features.mean(dim=1, keepdim=True)
            variance = (centred * centred).mean(dim=1, keepdim=True)
            return centred / torch.sqrt(variance + self.epsilon)
        channels_last = features.permute(0, 2, 3, 1)
        return functional.layer_norm(channels_last, channels_last.shape[-1:], eps=self.epsilon).permute(0, 3, 1, 2)


def simple_gate(features: Float[Tensor, "n c2 h w"], channels: int) -> Float[Tensor, "n c h w"]:
    """The first `channels` channels times the other half (SimpleGate, Chen et al. 2022)."""
    if torch.jit.is_tracing():
        return features[:, :channels] * features[:, channels:]
    # unlike that of slices, the gradient of `chunk` keeps the memory format
    first, second = features.chunk(2, dim=1)
    return first * second


class NAFBlock(nn.Module):
    """Maps [n, channels, h, w] to the same shape; the identity when new, as beta and gamma begin at zero.

    Its channel attention looks at the mean over the smoke, not over the picture (unlike the original), so
    that an empty border round the smoke changes nothing.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels
        self.norm = ChannelNorm()
        self.widen = nn.Conv2d(channels, 2 * channels, 1)
        self.depthwise = nn.Conv2d(2 * channels, 2 * channels, 3, padding=1, groups=2 * channels)
        self.attention = nn.Conv2d(channels, channels, 1)
        self.merge = nn.Conv2d(channels, channels, 1)
        self.beta = nn.Parameter(torch.zeros(channels))

        self.expand = nn.Conv2d(channels, 2 * channels, 1)
        self.contract = nn.Conv2d(channels, channels, 1)
        self.gamma = nn.Parameter(torch.zeros(channels))

        for convolution in (self.widen, self.depthwise, self.attention, self.merge, self.expand, self.contract):
            nn.init.kaiming_normal_(convolution.weight, nonlinearity="linear")
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]
        # attention near one lets the first steps train the rest of the block
        nn.init.ones_(self.attention.bias)  # type: ignore[arg-type]

    def forward(self, features: Float[Tensor, "n c h w"], smoke: Float[Tensor, "n 1 h w"]) -> Float[Tensor, "n c h w"]:
        """smoke: how much of it each pixel holds, over the mean of the picture (`share_of_smoke`)."""
        gated = simple_gate(self.depthwise(self.widen(self.norm(features))), self.channels)
        over_smoke = (gated * smoke).mean(dim=(2, 3), keepdim=True)
        features = features + _scaled(self.merge, self.beta, gated * self.attention(over_smoke))

        gated = simple_gate(self.expand(self.norm(features)), self.channels)
        return features + _scaled(self.contract, self.gamma, gated)


def _scaled(convolution: nn.Conv2d, factor: Tensor, features: Tensor) -> Tensor:
    """factor * convolution(features), the factor taken into the weights: no pass over the features for it."""
    assert convolution.bias is not None
    return functional.conv2d(features, factor[:, None, None, None] * convolution.weight, factor * convolution.bias)


def share_of_smoke(alpha: Float[Tensor, "n 1 h2 w2"]) -> Float[Tensor, "n 1 h w"]:
    """Weights of mean 1 for a mean over the smoke, at half of alpha's resolution; 0 where nothing is.

    The mean of weight x value is then sum(alpha value) / sum(alpha), and 0 for a picture without smoke.
    """
    pooled = functional.avg_pool2d(alpha, 2)
    return pooled / (pooled.mean(dim=(2, 3), keepdim=True) + 1e-6)
