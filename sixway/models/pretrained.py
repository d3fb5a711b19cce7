"""Weights that others have learnt: read only if they are, bit for bit, the file that was meant."""

from pathlib import Path

import torch
from torch import Tensor, nn

from sixway.core.store import sha256_file


def read_pinned_weights(path: Path, *, sha256: str) -> dict[str, Tensor]:
    """The tensors of a checkpoint by name, on the CPU; nothing but tensors is unpickled.

    Raises FileNotFoundError if there is no such file, ValueError if its SHA-256 is another.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such file of weights")
    found = sha256_file(path)
    if found != sha256:
        raise ValueError(
            f"{path}: its SHA-256 is {found}, expected {sha256}; this is another file, or part of one: get it anew"
        )
    weights: dict[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
    return weights


def freeze(net: nn.Module) -> None:
    """No gradients for the weights, running statistics as they are; what goes in may still want gradients."""
    net.requires_grad_(False)
    net.eval()
