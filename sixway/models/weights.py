"""Weights of our own nets on disk, and the card that names them."""

from pathlib import Path

from safetensors.torch import save_file
from torch import nn

from sixway.core.config import Config
from sixway.core.store import atomic_path, sha256_file, write_text


def save_with_card(net: nn.Module, card: Config, *, weights: Path, card_path: Path) -> None:
    """Write both, each whole; the card holds the hash of the weights as `weights_sha256`."""
    with atomic_path(weights) as temporary:
        save_file({name: tensor.contiguous() for name, tensor in net.state_dict().items()}, temporary)
    card = card.model_copy(update={"weights_sha256": sha256_file(weights)})
    write_text(card_path, card.model_dump_json(indent=1) + "\n")
