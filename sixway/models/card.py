"""A trained net on disk: its weights as safetensors and a card that says how to use them. No pickles."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file

from sixway.core.config import Config
from sixway.core.store import read_json, sha256_file
from sixway.models.unet import SixWayUNet, UNetConfig
from sixway.models.weights import save_with_card

WEIGHTS = "model.safetensors"
CARD = "model.json"


class NetCard(Config):
    """Everything that running the net takes, beside its weights.

    guide: config of the guide that the net reads, as the guide's room wrote it. scale: the six maps times
    this are what the net answers in; emissive_scale: likewise of emissive, None as `scale`. medium: how
    the smoke of its training met light. loss: what it was trained under, stand-ins named.
    """

    format: Literal[1] = 1
    net: UNetConfig
    guide_name: str
    guide: dict[str, Any]
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
    try:
        return NetCard.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the whole"
        raise ValueError(f"{source}: {place}: {first['msg']}; this is no card of a sixway net of format 1") from error


def load_net(folder: Path) -> tuple[SixWayUNet, NetCard]:
    """The net in evaluation mode, and its card.

    Raises FileNotFoundError if there is no trained net, ValueError if weights and card do not belong together.
    """
    if not (folder / CARD).is_file() or not (folder / WEIGHTS).is_file():
        raise FileNotFoundError(
            f"{folder}: holds no trained net ({CARD} and {WEIGHTS}); "
            f"run: python -m sixway.train CONFIG --run-dir {folder}"
        )
    read_json(folder / CARD)
    card = read_card((folder / CARD).read_bytes(), source=str(folder / CARD))
    if sha256_file(folder / WEIGHTS) != card.weights_sha256:
        raise ValueError(
            f"{folder / WEIGHTS}: is not the file that {CARD} names; copy both from one run, or train again"
        )
    net = SixWayUNet(
        card.net, guide_channels=card.guide_channels, guide_scale=card.scale, emissive_scale=card.emissive_scale
    )
    try:
        net.load_state_dict(load_file(folder / WEIGHTS))
    except (SafetensorError, RuntimeError) as error:
        raise ValueError(f"{folder / WEIGHTS}: cannot be loaded ({error}); train or copy it again") from error
    return net.eval(), card
