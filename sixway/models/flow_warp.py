"""Moving pictures by a flow, and flows from one size of picture to another."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional


def warp(picture: Float[Tensor, "n c h w"], flow: Float[Tensor, "n 2 h w"]) -> Float[Tensor, "n c h w"]:
    """picture(x + flow), bilinear; beyond the border, the border's value. flow: [px; right, down]."""
    height, width = picture.shape[2:]
    y = torch.arange(height, device=flow.device, dtype=flow.dtype)[:, None] + flow[:, 1]
    x = torch.arange(width, device=flow.device, dtype=flow.dtype)[None, :] + flow[:, 0]
    grid = torch.stack([(2.0 * x + 1.0) / width - 1.0, (2.0 * y + 1.0) / height - 1.0], dim=-1)
    return functional.grid_sample(picture, grid, mode="bilinear", padding_mode="border", align_corners=False)


def resized_flow(flow: Float[Tensor, "n 2 _ _"], *, height: int, width: int) -> Float[Tensor, "n 2 height width"]:
    """The flow on another grid over the same picture, its lengths in that grid's pixels."""
    if flow.shape[2:] == (height, width):
        return flow
    stretch = flow.new_tensor([width / flow.shape[3], height / flow.shape[2]]).reshape(1, 2, 1, 1)
    return functional.interpolate(flow, size=(height, width), mode="bilinear", align_corners=False) * stretch
