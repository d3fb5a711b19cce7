"""Distance between pictures as a feature extractor sees them (Johnson et al. 2016).

Only the six maps are seen so. Alpha and the emissive channel are left to the squared error: a picture of
opacity is none that a net trained on photographs knows, and fire is absent from most data.
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sixway.core.conventions import LIGHTMAP_CHANNELS

TRIPLES = (("right", "top", "back"), ("left", "bottom", "front"))
"""Three maps seen as one colour picture: the two RGB textures that engines keep."""

_TRIPLE_CHANNELS = tuple([LIGHTMAP_CHANNELS.index(name) for name in triple] for triple in TRIPLES)


@runtime_checkable
class FeatureExtractor(Protocol):
    """A colour picture to feature maps, such as the layers of VGG16. Frozen; differentiable in its input.

    name: what a run record calls it. pretrained: whether it holds weights learnt on photographs.
    """

    name: str
    pretrained: bool

    def __call__(self, picture: Float[Tensor, "n 3 h w"]) -> Sequence[Float[Tensor, "n _ _ _"]]:
        """picture: sRGB code, about [0, 1]. One map a layer, of any size."""
        ...


def random_triple(generator: torch.Generator) -> int:
    """Which of `TRIPLES` to look at. One of two, evenly drawn, is unbiased for their mean at half the cost."""
    return int(torch.randint(len(TRIPLES), (), generator=generator))


class PerceptualLoss(nn.Module):
    """Mean L1 distance of features, over the layers, for one triple of maps at a time."""

    def __init__(self, features: FeatureExtractor) -> None:
        super().__init__()
        self.features = features

    def forward(
        self, predicted: Float[Tensor, "n 8 h w"], target: Float[Tensor, "n 8 h w"], *, triple: int
    ) -> Float[Tensor, ""]:
        """Both in `LIGHTMAP_CHANNELS` order, sRGB-encoded; triple: an index into `TRIPLES`."""
        channels = _TRIPLE_CHANNELS[triple]
        # fp32: where the pictures are within 40 dB, bf16 features turn the gradient by 30 degrees
        with torch.autocast(predicted.device.type, enabled=False):
            with torch.no_grad():
                wanted = self.features(target[:, channels].float())
            layers = zip(self.features(predicted[:, channels].float()), wanted, strict=True)
            return torch.stack([(got - want).abs().mean() for got, want in layers]).mean()
