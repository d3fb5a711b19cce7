"""Clips: pairs of consecutive frames, the unit that a flow loss and a temporal metric need."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Batch:
    """Consecutive frames of some views, interleaved [a0, a1, b0, b1, ...].

    guide: raw guide channels. target: linear lightmaps M in the order of `LIGHTMAP_CHANNELS`; the
    emissive channel is zero where the dataset has none.
    """

    guide: Float[Tensor, "n g h w"]
    target: Float[Tensor, "n 8 h w"]
