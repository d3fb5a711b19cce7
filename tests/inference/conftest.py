"""A trained net and its exported files."""

from pathlib import Path

import numpy as np
import pytest

from sixway.data.dataset import SmokeDataset
from sixway.export import training_guides
from sixway.inference.onnx import export_onnx, finish_dynamic, trace_dynamic
from sixway.inference.onnx_rules import Precision
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
def dynamic_files(trained_run: Path, tiny_dataset, tmp_path_factory: pytest.TempPathFactory) -> dict[Precision, Path]:
    """The run for ONNX Runtime at any size, by precision; int8 calibrated on the dataset."""
    net, card = load_net(trained_run)
    graph = trace_dynamic(net, card)
    guides = training_guides(tiny_dataset.folder, card, net.stride)
    precisions: tuple[Precision, ...] = ("fp32", "fp16", "int8")
    files = {p: tmp_path_factory.mktemp("ort") / f"{p}.onnx" for p in precisions}
    for precision, path in files.items():
        finish_dynamic(graph, net, card, path, precision=precision, guides=guides)
    return files


@pytest.fixture(scope="session")
def real_guide(tiny_dataset) -> np.ndarray:
    """Guides of two test frames, [2, 8, 20, 24]."""
    return SmokeDataset(tiny_dataset.folder, guide="six", split="test").pair(0, 1).guide.numpy()
