"""Gradients at several scales, as features for a perceptual loss. There are no weights: NOT a pretrained net."""

from jaxtyping import Float
from kornia.filters import spatial_gradient
from kornia.geometry.transform import pyrdown
from torch import Tensor, nn

_SMALLEST_SIDE_PX = 4


class GradientFeatures(nn.Module):
    """Sobel gradients of each colour on a Gaussian pyramid: edges and soft edges, nothing learnt.

    A stand-in for the features of VGG16 where no weights can be had. It rewards the right structure
    and knows nothing of how smoke looks. A pretrained net takes its place by injection.
    """

    name = "gradients"
    pretrained = False

    def __init__(self, *, levels: int = 3) -> None:
        super().__init__()
        if levels < 1:
            raise ValueError(f"gradient features need at least 1 level, got {levels}")
        self.levels = levels

    def forward(self, picture: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n 6 _ _"]]:
        """One map of 6 gradients (right and down of each colour; per px) a level, finest first.

        Small pictures have fewer levels: none is coarser than 4 px.
        """
        features: list[Tensor] = []
        while True:
            features.append(spatial_gradient(picture).flatten(1, 2))
            if len(features) == self.levels or min(picture.shape[2:]) < 2 * _SMALLEST_SIDE_PX:
                return features
            picture = pyrdown(picture)
