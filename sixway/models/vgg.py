"""VGG16 (Simonyan & Zisserman 2015) as far as its third group, for the perceptual loss that the paper trains with."""

from collections.abc import Mapping
from http.client import HTTPException
from pathlib import Path
from urllib.error import URLError

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sixway.models.pretrained import freeze, read_pinned_weights

URL = "https://download.pytorch.org/models/vgg16-397923af.pth"
SHA256 = "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0"
"""The public checkpoint of torchvision, learnt on ImageNet (553 MB, most of it in layers that are left out here)."""

_WIDTHS = ((64, 64), (128, 128), (256, 256, 256))
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the RGB values in [0, 1] that the net was trained on."""


class VGG16Features(nn.Module):
    """relu1_2, relu2_2 and relu3_3: 64, 128 and 256 maps at full, half and quarter resolution.

    weights: tensors by name, as in the checkpoint of torchvision; those of later layers are passed over.
    Raises ValueError if one is missing or of another shape.
    """

    name = "vgg16"
    pretrained = True
    mean: Tensor
    deviation: Tensor

    def __init__(self, weights: Mapping[str, Tensor]) -> None:
        super().__init__()
        self.features, self._taps = _trunk()
        wanted = {name: weights[name] for name in self.state_dict() if name in weights}
        try:
            self.load_state_dict(wanted, strict=True)
        except RuntimeError as error:
            raise ValueError(f"these are not the weights of VGG16 as torchvision names them: {error}") from error
        self.register_buffer("mean", torch.tensor(_MEAN).reshape(1, 3, 1, 1), persistent=False)
        self.register_buffer("deviation", torch.tensor(_DEVIATION).reshape(1, 3, 1, 1), persistent=False)
        freeze(self)

    @classmethod
    def load(cls, path: Path | None = None) -> "VGG16Features":
        """The net with torchvision's weights, from `path` or downloaded once into torch's cache ($TORCH_HOME).

        Raises FileNotFoundError if the file is absent and out of reach, ValueError if it is another file.
        """
        return cls(read_pinned_weights(_download() if path is None else path, sha256=SHA256))

    def forward(self, picture: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n _ _ _"]]:
        """picture: sRGB code, about [0, 1], at least 4 px wide and high. Finest first."""
        values = (picture - self.mean) / self.deviation
        taps = []
        for index, layer in enumerate(self.features):
            values = layer(values)
            if index in self._taps:
                taps.append(values)
        return taps


def _trunk() -> tuple[nn.Sequential, set[int]]:
    """The layers, numbered as the checkpoint numbers them, and which of them are looked at."""
    layers: list[nn.Module] = []
    taps: set[int] = set()
    channels = 3
    for group in _WIDTHS:
        if layers:
            layers.append(nn.MaxPool2d(2))
        for width in group:
            layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            channels = width
        taps.add(len(layers) - 1)
    return nn.Sequential(*layers), taps


def _download() -> Path:
    """Where torch keeps the checkpoint, after fetching it if it is not there yet."""
    path = Path(torch.hub.get_dir()) / "checkpoints" / URL.rpartition("/")[2]
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            # writes beside and renames, so nobody finds half a file
            torch.hub.download_url_to_file(URL, str(path), hash_prefix=SHA256)
        except (URLError, HTTPException, TimeoutError, ConnectionError, RuntimeError) as error:
            raise FileNotFoundError(
                f"the weights of VGG16 are not at {path} and {URL} gave none ({error}); fetch it on another machine "
                "and set loss.vgg_weights=PATH, or set loss.features=efficientnet_lite0"
            ) from error
    return path
