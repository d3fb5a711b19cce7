"""Does the predicted smoke move as the true smoke does? Compares optical flow between consecutive frames."""

from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS

_ALPHA = LIGHTMAP_CHANNELS.index("alpha")
_SMALLEST_AREA_PX = 1.0

_DARKEST = 0.02
"""Where the true picture is darker than this (sRGB code) there is nothing to see moving."""


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
    of the first frame, on whose pixels it stands: empty space has no motion to get wrong, and what is
    nearly black, or gone to black a frame later, none to be seen.
    """

    def __init__(self, estimator: FlowEstimator) -> None:
        super().__init__()
        self.estimator = estimator

    def forward(
        self,
        predicted: Float[Tensor, "n 8 h w"],
        target: Float[Tensor, "n 8 h w"],
        true_flow: Float[Tensor, "m 2 h w"] | None = None,
    ) -> Float[Tensor, ""]:
        """Batches of interleaved pairs [a0, a1, b0, b1, ...]; an odd batch is a ValueError. Black frames: 0.

        true_flow: `flow_of` the target, of m = n / 2 pairs, kept from earlier: half the cost. None
        finds it now.
        """
        if true_flow is None:
            with torch.no_grad():
                true_flow = self.flow_of(target)
        elif 2 * len(true_flow) != len(target):
            raise ValueError(
                f"true_flow holds {len(true_flow)} flows for {len(target)} frames; give one for every two frames"
            )
        distance = (self.flow_of(predicted) - true_flow).abs().mean(dim=1, keepdim=True)
        first, second = _lit_pair(target)
        seen = (first > _DARKEST) & (second.amax(dim=(1, 2, 3), keepdim=True) > _DARKEST)
        weight = target[0::2, _ALPHA : _ALPHA + 1].clamp(0.0, 1.0) * seen
        return (distance * weight).sum() / weight.sum().clamp_min(_SMALLEST_AREA_PX)

    def flow_of(self, frames: Float[Tensor, "n 8 h w"]) -> Float[Tensor, "n//2 2 h w"]:
        """Flow from the first to the second frame of every pair [px; right, down]; an odd batch is a ValueError."""
        if len(frames) % 2:
            raise ValueError(f"the flow loss needs pairs of frames [a0, a1, b0, b1, ...], got {len(frames)} frames")
        return self.estimator(*_lit_pair(frames))


def _lit_pair(lightmap: Tensor) -> tuple[Tensor, Tensor]:
    """Mean of the six maps of the first and of the second frames, [n/2, 1, h, w] each."""
    lit = lightmap[:, : len(DIRECTIONS)].mean(dim=1, keepdim=True)
    return lit[0::2], lit[1::2]
