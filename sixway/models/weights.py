"""Weights of our own nets on disk, and the card that names them. No pickles.

A kill at any moment leaves a pair that belongs together: the next card is laid down first, then the weights are
replaced, then the card. Whoever finds weights that the card does not name finds, beside it, the one that does.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import nn

from sixway.core.config import STORED, Config
from sixway.core.store import atomic_path, read_json, sha256_file, write_text

Card = TypeVar("Card", bound=Config)
Net = TypeVar("Net", bound=nn.Module)


def save_with_card(net: nn.Module, card: Config, *, weights: Path, card_path: Path) -> None:
    """Write both, each whole; the card holds the hash of the weights as `weights_sha256`."""
    coming = _next(card_path)
    if coming.is_file() and weights.is_file() and _names(coming, sha256_file(weights)):
        os.replace(coming, card_path)  # what a killed writer left undone
    with atomic_path(weights) as temporary:
        save_file({name: tensor.contiguous() for name, tensor in net.state_dict().items()}, temporary)
        card = card.model_copy(update={"weights_sha256": sha256_file(temporary)})
        write_text(coming, card.model_dump_json(indent=1) + "\n")
    os.replace(coming, card_path)


def load_with_card(
    model: type[Card], build: Callable[[Card], Net], *, weights: Path, card_path: Path, kind: str, made_by: str
) -> tuple[Net, Card]:
    """The net that `build` makes by its card, with its weights, in evaluation mode; and the card.

    model: of the card, with a field `weights_sha256`. kind: of the net, and made_by: the command that makes it, for
    messages. Raises FileNotFoundError if there is no such net, ValueError if weights and card do not belong together.
    """
    if not card_path.is_file() or not weights.is_file():
        raise FileNotFoundError(
            f"{weights.parent}: holds no trained net ({card_path.name} and {weights.name}); "
            f"run: {made_by} --run-dir {weights.parent}"
        )
    cards = [path for path in (card_path, _next(card_path)) if path.is_file()]
    found = sha256_file(weights)
    named = [path for path in cards if _names(path, found)]
    path = (named or cards)[0]
    card = parse_card(model, path.read_bytes(), source=str(path), kind=kind)
    if not named:
        raise ValueError(
            f"{weights}: is not the file that {card_path.name} names; copy both from one run, or train again"
        )
    net = build(card)
    try:
        net.load_state_dict(load_file(weights))
    except (SafetensorError, RuntimeError) as error:
        raise ValueError(f"{weights}: cannot be loaded ({error}); train or copy it again") from error
    return net.eval(), card


def parse_card(model: type[Card], text: str | bytes, *, source: str, kind: str) -> Card:
    """Check a card; raises ValueError naming `source` and what does not fit."""
    try:
        return model.model_validate_json(text, context=STORED)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the whole"
        raise ValueError(f"{source}: {place}: {first['msg']}; this is no card of a {kind} of format 1") from error


def _names(card_path: Path, weights_sha256: str) -> bool:
    told = read_json(card_path)
    return isinstance(told, dict) and told.get("weights_sha256") == weights_sha256


def _next(card_path: Path) -> Path:
    return card_path.with_suffix(".next" + card_path.suffix)
