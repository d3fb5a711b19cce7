"""Does the predicted smoke move as the true smoke does? Compares optical flow between consecutive frames."""

from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS

_ALPHA = LIGHTMAP_CHANNELS.index("alpha")
_SMALLEST_AREA_PX = 1.0


@runtime_checkable
class FlowEstimator(Protocol):
    """Two grey pictures to the flow [px; right, down] on the pixels of the first. Frozen, differentiable.

    name: what a run record calls it. pretrained: whether it holds learnt weights.
    """

    name: str
    pretrained: bool

    def __call__(self, first: Float[Tensor, "n 1 h w"], second: Float[Tensor, "n 1 h w"]) -> Float[Tensor, "n 2 h w"]:
        """Pictures: sRGB code, about [0, 1]."""
        ...


class FlowLoss(nn.Module):
    """Mean L1 distance [px] between the flow of the predicted pair and that of the true pair.

    Flow is seen on the mean of the six maps, as if all lights were on, and weighted by the true alpha
    of the first frame, on whose pixels it stands: empty space has no motion to get wrong.
    """

    def __init__(self, estimator: FlowEstimator) -> None:
        super().__init__()
        self.estimator = estimator

    def forward(self, predicted: Float[Tensor, "n 8 h w"], target: Float[Tensor, "n 8 h w"]) -> Float[Tensor, ""]:
        """Batches of interleaved pairs [a0, a1, b0, b1, ...]; an odd batch is a ValueError. Black frames: 0."""
        if len(target) % 2:
            raise ValueError(f"the flow loss needs pairs of frames [a0, a1, b0, b1, ...], got {len(target)} frames")
        with torch.no_grad():
            true_flow = self.estimator(*_lit_pair(target))
        distance = (self.estimator(*_lit_pair(predicted)) - true_flow).abs().mean(dim=1, keepdim=True)
        alpha = target[0::2, _ALPHA : _ALPHA + 1].clamp(0.0, 1.0)
        return (distance * alpha).sum() / alpha.sum().clamp_min(_SMALLEST_AREA_PX)


def _lit_pair(lightmap: Tensor) -> tuple[Tensor, Tensor]:
    """Mean of the six maps of the first and of the second frames, [n/2, 1, h, w] each."""
    lit = lightmap[:, : len(DIRECTIONS)].mean(dim=1, keepdim=True)
    return lit[0::2], lit[1::2]
