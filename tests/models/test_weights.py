"""Weights and card: whatever moment a writer is killed at, what is there can be read, and belongs together."""

import os
from pathlib import Path

import pytest
import torch
from torch import nn

from sixway.core.config import Config
from sixway.models import weights as module
from sixway.models.weights import load_with_card, save_with_card


class Card(Config):
    version: int
    weights_sha256: str = ""


class Killed(BaseException):
    """Nothing of the writer's handles it."""


def paths(folder: Path) -> dict[str, Path]:
    return {"weights": folder / "net.safetensors", "card_path": folder / "net.json"}


def save(folder: Path, version: int) -> None:
    net = nn.Linear(1, 1)
    nn.init.constant_(net.weight, version)
    save_with_card(net, Card(version=version), **paths(folder))


def version(folder: Path) -> int:
    """Of the pair in the folder; weights and card must agree on it."""
    net, card = load_with_card(Card, lambda _: nn.Linear(1, 1), **paths(folder), kind="line", made_by="rule")
    assert torch.equal(net.weight.detach(), torch.full((1, 1), float(card.version)))
    return card.version


def save_killed(folder: Path, version: int, *, at: int, after: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Save, killed right before or after the renaming number `at`, which is all that shows of a writer."""
    renamed: list[object] = []
    replace = os.replace

    def kill(source: object, target: object) -> None:
        renamed.append(target)
        if len(renamed) - 1 == at and not after:
            raise Killed
        replace(source, target)  # type: ignore[arg-type]
        if len(renamed) - 1 == at:
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(module.os, "replace", kill)
        with pytest.raises(Killed):
            save(folder, version)


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("at", [0, 1, 2])
def test_a_kill_leaves_the_old_pair_or_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int, after: bool
) -> None:
    save(tmp_path, 1)
    save_killed(tmp_path, 2, at=at, after=after, monkeypatch=monkeypatch)
    weights_are_new = (at, after) >= (1, True)  # renamed are: the next card, the weights, the card
    assert version(tmp_path) == (2 if weights_are_new else 1)
    for again in range(3):  # and a second writer that is killed as well
        save_killed(tmp_path, 3, at=again, after=after, monkeypatch=monkeypatch)
        assert version(tmp_path) in (1, 2, 3)
    save(tmp_path, 4)
    assert version(tmp_path) == 4
    assert {path.name for path in tmp_path.iterdir()} == {"net.safetensors", "net.json"}


def test_a_first_pair_is_there_when_it_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for at in range(3):
        save_killed(tmp_path, 1, at=at, after=False, monkeypatch=monkeypatch)
        with pytest.raises(FileNotFoundError, match="holds no trained net"):
            version(tmp_path)
    save(tmp_path, 1)
    assert version(tmp_path) == 1


def test_a_pair_of_two_runs_is_refused(tmp_path: Path) -> None:
    for name in ("a", "b"):
        save(tmp_path / name, ord(name))
    os.replace(tmp_path / "a/net.safetensors", tmp_path / "b/net.safetensors")
    with pytest.raises(ValueError, match=r"net\.safetensors: is not the file that net\.json names"):
        version(tmp_path / "b")


@pytest.mark.parametrize(
    ("text", "message"), [("[1]", "no card of a line"), ("{", "not valid JSON"), ('{"version": "x"}', "version: ")]
)
def test_what_is_no_card_is_told(tmp_path: Path, text: str, message: str) -> None:
    save(tmp_path, 1)
    (tmp_path / "net.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        version(tmp_path)
