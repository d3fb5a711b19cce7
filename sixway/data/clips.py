"""Clips: pairs of consecutive frames, the unit that a flow loss and a temporal metric need."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Batch:
    """Consecutive frames of some views, interleaved [a0, a1, b0, b1, ...].

    guide: raw guide channels. target: linear lightmaps M in the order of `LIGHTMAP_CHANNELS`; the
    emissive channel is zero where the dataset has none. flow: where known, the motion of each pair's
    true frames [px; right, down], on the pixels of its first.
    """

    guide: Float[Tensor, "n g h w"]
    target: Float[Tensor, "n 8 h w"]
    flow: Float[Tensor, "p 2 h w"] | None = None

    def to(self, device: str) -> "Batch":
        """The batch on a device, channels-last. The copy to a GPU is not waited for."""
        pinned = torch.device(device).type == "cuda"

        def moved(images: Tensor) -> Tensor:
            images = images.contiguous(memory_format=torch.channels_last)
            return images.pin_memory().to(device, non_blocking=True) if pinned else images.to(device)

        return Batch(
            guide=moved(self.guide),
            target=moved(self.target),
            flow=None if self.flow is None else moved(self.flow),
        )


def join(batches: list[Batch]) -> Batch:
    """Several as one; all of them carry flow, or none."""
    flows = [batch.flow for batch in batches if batch.flow is not None]
    return Batch(
        guide=torch.cat([batch.guide for batch in batches]),
        target=torch.cat([batch.target for batch in batches]),
        flow=torch.cat(flows) if flows else None,
    )
