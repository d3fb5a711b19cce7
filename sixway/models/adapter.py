"""Channel adapter: what the shared decoder knows, told for a few lightmap channels."""

from jaxtyping import Float
from torch import Tensor, nn

from sixway.models.nafblock import NAFBlock

_HEAD_GAIN = 0.1


class ChannelAdapter(nn.Module):
    """Features at half resolution to channels at full resolution: 1x1, NAFBlocks, 3x3, PixelShuffle.

    The head starts small, so that a new net answers with little more than the guide's own maps.
    """

    def __init__(self, in_channels: int, out_channels: int, *, width: int, blocks: int) -> None:
        super().__init__()
        self.enter = nn.Conv2d(in_channels, width, 1)
        self.blocks = nn.ModuleList(NAFBlock(width) for _ in range(blocks))
        self.head = nn.Conv2d(width, 4 * out_channels, 3, padding=1)
        self.to_full_resolution = nn.PixelShuffle(2)

        nn.init.kaiming_normal_(self.enter.weight, nonlinearity="linear")
        nn.init.kaiming_normal_(self.head.weight, nonlinearity="linear")
        self.head.weight.data.mul_(_HEAD_GAIN)
        for convolution in (self.enter, self.head):
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]

    def forward(
        self, features: Float[Tensor, "n f half_h half_w"], smoke: Float[Tensor, "n 1 half_h half_w"]
    ) -> Float[Tensor, "n c h w"]:
        """smoke: weights of `nafblock.share_of_smoke`."""
        features = self.enter(features)
        for block in self.blocks:
            features = block(features, smoke)
        return self.to_full_resolution(self.head(features))
