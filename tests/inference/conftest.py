"""A trained net and its exported file."""

from pathlib import Path

import numpy as np
import pytest

from sixway.data.dataset import SmokeDataset
from sixway.inference.onnx import export_onnx
from sixway.models.card import NetCard, load_net


@pytest.fixture(scope="session")
def card(trained_run: Path) -> NetCard:
    return load_net(trained_run)[1]


@pytest.fixture(scope="session")
def exported(trained_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run as ONNX at 24 x 20 px, the size of its dataset."""
    path = tmp_path_factory.mktemp("onnx") / "net.onnx"
    export_onnx(*load_net(trained_run), path, width_px=24, height_px=20)
    return path


@pytest.fixture(scope="session")
def real_guide(tiny_dataset) -> np.ndarray:
    """Guides of two test frames, [2, 8, 20, 24]."""
    return SmokeDataset(tiny_dataset.folder, guide="six", split="test").pair(0, 1).guide.numpy()
