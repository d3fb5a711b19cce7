"""Fixtures that every test folder shares."""

import os
from pathlib import Path

import numpy as np
import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="cpu or cuda: where the kernels under test run")


@pytest.fixture
def device(request: pytest.FixtureRequest) -> str:
    """The device that kernels and nets run on; `pytest --device cuda` runs the same tests there."""
    name: str = request.config.getoption("--device")
    if name == "cuda":
        import torch

        if not torch.cuda.is_available():
            pytest.skip("no CUDA device on this machine")
    return name


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def real_volumes() -> Path:
    """The folder with volumes that nobody here wrote."""
    folder = os.environ.get("SIXWAY_REAL_VOLUMES")
    if not folder or not Path(folder).is_dir():
        pytest.skip("SIXWAY_REAL_VOLUMES names no folder with real volumes")
    return Path(folder)
