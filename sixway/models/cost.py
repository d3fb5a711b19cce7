"""What a net costs: multiply-adds, counted by torch or from the shapes."""

import copy

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

_TAPS = 3 * 3


def gmac(net: nn.Module, height_px: int, width_px: int) -> float:
    """Billions of multiply-adds of one picture through a `SixWayUNet`: its convolutions, which is nearly all.

    Counted on shapes alone, in milliseconds at any size.
    """
    shapes = copy.deepcopy(net).to("meta").eval()
    guide = torch.empty(1, len(net.guide_channels), height_px, width_px, device="meta")  # type: ignore[arg-type]
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        shapes(guide)
    return counter.get_total_flops() / 2e9


def adapter_macs(in_channels: int, out_channels: int, width: int, blocks: int) -> int:
    """Multiply-adds of a `ChannelAdapter` a pixel at half resolution."""
    enter, head = in_channels * width, _TAPS * width * 4 * out_channels
    # widen, depthwise, merge, expand, contract
    block = (2 + 1 + 2 + 1) * width * width + _TAPS * 2 * width
    return enter + blocks * block + head
