"""A trained net on disk: its weights as safetensors and a card that says how to use them. No pickles."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from sixway.core.config import Config, Identity
from sixway.models.unet import SixWayUNet, UNetConfig
from sixway.models.weights import load_with_card, parse_card, save_with_card

WEIGHTS = "model.safetensors"
CARD = "model.json"
_KIND = "sixway net"


class NetCard(Config):
    """Everything that running the net takes, beside its weights.

    guide: that the net reads; `guide.config.stored_guide` makes its config of it. scale: the six maps times
    this are what the net answers in; emissive_scale: likewise of emissive, None as `scale`. medium: how
    the smoke of its training met light. loss: what it was trained under, stand-ins named.
    """

    format: Literal[1] = 1
    net: UNetConfig
    guide_name: str
    guide: Identity
    guide_channels: tuple[str, ...]
    scale: float = Field(gt=0.0)
    emissive_scale: float | None = Field(default=None, gt=0.0)
    has_emissive: bool
    medium: dict[str, float]
    height_px: int
    width_px: int
    steps: int
    dataset: str
    dataset_sha256: str
    loss: dict[str, Any]
    provenance: dict[str, str]
    weights_sha256: str = ""


def save_net(folder: Path, net: SixWayUNet, card: NetCard) -> None:
    """Write weights and card, each whole; the card holds the hash of the weights."""
    save_with_card(net, card, weights=folder / WEIGHTS, card_path=folder / CARD)


def read_card(text: str | bytes, *, source: str) -> NetCard:
    """Check a card; raises ValueError naming `source` and what does not fit."""
    return parse_card(NetCard, text, source=source, kind=_KIND)


def load_net(folder: Path) -> tuple[SixWayUNet, NetCard]:
    """The net in evaluation mode, and its card.

    Raises FileNotFoundError if there is no trained net, ValueError if weights and card do not belong together.
    """
    return load_with_card(
        NetCard,
        lambda card: SixWayUNet(
            card.net, guide_channels=card.guide_channels, guide_scale=card.scale, emissive_scale=card.emissive_scale
        ),
        weights=folder / WEIGHTS,
        card_path=folder / CARD,
        kind=_KIND,
        made_by="python -m sixway.train CONFIG",
    )
