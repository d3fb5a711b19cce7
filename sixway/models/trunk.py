"""The U-shaped part of the net: from full to half resolution, down to the bottleneck and up again."""

from itertools import pairwise

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

_LEAK = 0.1
_RESIDUAL_GAIN = 0.2
_FAINTEST_ALPHA = 0.01


class ResidualBlock(nn.Module):
    """x + 0.2 conv(leaky(conv(x))) where smoke is: the small gain keeps a deep, norm-free trunk calm at the start."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.activation = nn.LeakyReLU(_LEAK)
        self.second = nn.Conv2d(channels, channels, 3, padding=1, bias=False)

    def forward(
        self, features: Float[Tensor, "n c h w"], occupied: Float[Tensor, "n 1 h w"]
    ) -> Float[Tensor, "n c h w"]:
        inner = self.activation(self.first(features)) * occupied
        return (features + _RESIDUAL_GAIN * self.second(inner)) * occupied


class Downsample(nn.Sequential):
    """Half the resolution, by a strided 2x2 convolution."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(nn.Conv2d(in_channels, out_channels, 2, stride=2, bias=False))


class Upsample(nn.Sequential):
    """Twice the resolution: 1x1 convolution and PixelShuffle, which leaves no holes or overlaps."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(nn.Conv2d(in_channels, 4 * out_channels, 1, bias=False), nn.PixelShuffle(2))


class Trunk(nn.Module):
    """Guide at full resolution to features of ``widths[0]`` channels at half resolution.

    widths: channels at 1/2, 1/4, ... of the resolution; the last one is the bottleneck. Height and
    width must be multiples of `stride`. Skips are added, not concatenated: half the decoder's cost.
    Features live where smoke is: convolutions have no bias, and what they spill into empty space is
    cut off at every level. So empty space is the same as the zeros beyond the picture, and an empty
    border changes nothing.
    """

    def __init__(self, in_channels: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.stride = 2 ** len(widths)
        # a 6x6 kernel at stride 2 sees what space-to-depth and a 3x3 would, and exports as one Conv
        self.stem = nn.Conv2d(in_channels, widths[0], 6, stride=2, padding=2, bias=False)
        self.encoder = nn.ModuleList(ResidualBlock(width) for width in widths)
        self.down = nn.ModuleList(Downsample(wide, deep) for wide, deep in pairwise(widths))
        self.up = nn.ModuleList(Upsample(deep, wide) for wide, deep in pairwise(widths))
        self.decoder = nn.ModuleList(ResidualBlock(width) for width in widths[:-1])

        _calm(self)

    def forward(
        self, guide: Float[Tensor, "n g h w"], alpha: Float[Tensor, "n 1 h w"]
    ) -> Float[Tensor, "n f half_h half_w"]:
        """alpha: how much smoke the guide shows."""
        features = self.stem(guide)
        occupied = (functional.avg_pool2d(alpha, 2) / _FAINTEST_ALPHA).clip(0.0, 1.0)
        if occupied.dtype != features.dtype:  # under autocast; the exporter would write a Cast for nothing
            occupied = occupied.to(features.dtype)
        features = self.encoder[0](features * occupied, occupied)
        skips = []
        for down, block in zip(self.down, self.encoder[1:], strict=True):
            skips.append((features, occupied))
            # 1 where any of the four is
            occupied = (4.0 * functional.avg_pool2d(occupied, 2)).clip(0.0, 1.0)
            features = block(down(features), occupied)
        for up, block in zip(reversed(self.up), reversed(self.decoder), strict=True):
            skip, occupied = skips.pop()
            features = block(up(features) + skip, occupied)
        return features


def _calm(trunk: Trunk) -> None:
    """He initialisation by what follows each convolution, so that no level amplifies its input by much."""
    followed = {block.first for block in trunk.modules() if isinstance(block, ResidualBlock)}
    for module in trunk.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.kaiming_normal_(
                module.weight, a=_LEAK, nonlinearity="leaky_relu" if module in followed else "linear"
            )
