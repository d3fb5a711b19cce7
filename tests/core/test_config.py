"""Configs: every mistake at once, with its line and a remedy."""

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from sixway.core.config import Config, ConfigError, Introduced, dump_config, load_config, parse_config


class Optimiser(Config):
    lr: float = Field(gt=0.0)
    epochs: int = 3
    kind: Literal["adam", "sgd"] = "adam"


class Sphere(Config):
    kind: Literal["sphere"] = "sphere"
    radius_m: float


class Cylinder(Config):
    kind: Literal["cylinder"] = "cylinder"
    height_m: float


class Root(Config):
    train: Optimiser
    shapes: tuple[Annotated[Sphere | Cylinder, Field(discriminator="kind")], ...] = ()


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return path


def test_all_mistakes_come_at_once_with_their_lines(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        "train:\n  lr: -1\n  epoch: 3\n  epochs: 10.5\n  kind: adm\nshapes:\n  - {kind: sphere, radius: 2.0}\n",
    )
    with pytest.raises(ConfigError) as caught:
        load_config(Root, path)
    lines = str(caught.value).splitlines()
    assert f"{path}:2: train.lr: input should be greater than 0 (got -1)" in lines
    assert f"{path}:3: train.epoch: unknown key; did you mean 'epochs'?" in lines
    assert any(line.startswith(f"{path}:4: train.epochs:") for line in lines)
    assert any(line.startswith(f"{path}:5: train.kind:") and "'adam' or 'sgd'" in line for line in lines)
    assert f"{path}:7: shapes.0.radius: unknown key; did you mean 'radius_m'?" in lines
    assert f"{path}:7: shapes.0.radius_m: this key is required" in lines


def test_overrides_are_yaml_1_2_and_get_the_same_checks(tmp_path: Path) -> None:
    path = write(tmp_path, "train: {lr: 1e-3}\n")
    assert load_config(Root, path, ["train.lr=2e-4", "train.kind=sgd"]).train.lr == 2e-4
    with pytest.raises(ConfigError, match=r"command line: train\.lr=-1: train\.lr: input should be greater than 0"):
        load_config(Root, path, ["train.lr=-1"])
    with pytest.raises(ConfigError, match=r"train\.lrr: unknown key; did you mean 'lr'"):
        load_config(Root, path, ["train.lrr=1"])
    with pytest.raises(ConfigError, match=r"not of the form key\.subkey=value"):
        load_config(Root, path, ["train.lr"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("train: {lr: 1.0}\ntrain: {lr: 2.0}\n", "duplicate key"),
        ("train: [1\n", ":2:"),
        ("just text\n", "mapping of keys"),
        ("train: {lr: yes}\n", "valid number"),
        ("train: {lr: '1e-3'}\n", "valid number"),
        ("train: {lr: .nan}\n", "finite|valid"),
    ],
)
def test_files_that_are_no_config(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        load_config(Root, write(tmp_path, text))


def test_what_is_dumped_reads_back_equal(tmp_path: Path) -> None:
    config = Root(train=Optimiser(lr=1e-5), shapes=(Cylinder(height_m=2.0),))
    assert load_config(Root, write(tmp_path, dump_config(config))) == config


def test_values_kept_in_a_checkpoint_are_checked_too() -> None:
    with pytest.raises(ConfigError, match=r"card\.json.*train\.lr"):
        parse_config(Root, {"train": {"lr": 0.0}}, source="card.json")


class NewSphere(Sphere):
    squash: Annotated[float, Introduced(1.0)] = Field(default=1.0, gt=0.0)


class NewOptimiser(Optimiser):
    warmup: Annotated[tuple[int, ...], Introduced([])] = (5,)
    """A default that changed after the field came."""
    held: Annotated[NewSphere | None, Introduced(None)] = None


class NewRoot(Config):
    train: NewOptimiser
    shapes: tuple[Annotated[NewSphere | Cylinder, Field(discriminator="kind")], ...] = ()
    named: Annotated[dict[str, NewSphere | Cylinder], Introduced({})] = Field(default_factory=dict)


def test_a_field_that_came_later_leaves_the_identity_as_it_was() -> None:
    old = Root(train=Optimiser(lr=1e-5), shapes=(Sphere(radius_m=1.0), Cylinder(height_m=2.0)))
    assert old.identity() == old.model_dump(mode="json")
    new = parse_config(NewRoot, old.model_dump(mode="json"), source="card.json", stored=True)
    assert new.identity() == old.identity()
    assert new.model_dump(mode="json") == {
        "train": {**old.model_dump(mode="json")["train"], "warmup": [], "held": None},
        "shapes": [{"kind": "sphere", "radius_m": 1.0, "squash": 1.0}, {"kind": "cylinder", "height_m": 2.0}],
        "named": {},
    }


def test_a_field_that_came_later_counts_where_it_differs_however_deep() -> None:
    squashed = NewSphere(radius_m=1.0, squash=0.5)
    new = NewRoot(
        train=NewOptimiser(lr=1e-5, warmup=(), held=NewSphere(radius_m=3.0)),
        shapes=(squashed, NewSphere(radius_m=1.0), Cylinder(height_m=2.0)),
        named={"a": squashed, "b": NewSphere(radius_m=2.0)},
    )
    assert new.identity() == {
        "train": {"lr": 1e-5, "epochs": 3, "kind": "adam", "held": {"kind": "sphere", "radius_m": 3.0}},
        "shapes": [
            {"kind": "sphere", "radius_m": 1.0, "squash": 0.5},
            {"kind": "sphere", "radius_m": 1.0},
            {"kind": "cylinder", "height_m": 2.0},
        ],
        "named": {"a": {"kind": "sphere", "radius_m": 1.0, "squash": 0.5}, "b": {"kind": "sphere", "radius_m": 2.0}},
    }
    again = parse_config(NewRoot, new.identity(), source="card.json", stored=True)
    assert again == new and again.identity() == new.identity()


def test_a_stored_config_is_read_with_the_defaults_of_its_time_and_a_written_one_with_todays(tmp_path: Path) -> None:
    path = write(tmp_path, "train: {lr: 1e-3}\n")
    assert load_config(NewRoot, path).train.warmup == (5,)
    assert load_config(NewRoot, path, stored=True).train.warmup == ()
    assert load_config(NewRoot, path).identity()["train"]["warmup"] == [5]
    assert "warmup" not in load_config(NewRoot, path, stored=True).identity()["train"]
