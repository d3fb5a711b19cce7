"""Short runs on the tiny dataset, and how they are compared."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sixway.core.config import load_config
from sixway.training.config import TrainConfig


@pytest.fixture
def config(tiny_dataset: Any, trained_run: Path) -> Callable[..., TrainConfig]:
    """The config of `trained_run`, cut to 12 steps, with overrides."""

    def read(*overrides: str) -> TrainConfig:
        short = ("train.steps=12", "train.log_every=1", "train.validate_every=6", "train.checkpoint_every=6")
        return load_config(TrainConfig, trained_run.parent / "train.yaml", (*short, *overrides))

    return read
