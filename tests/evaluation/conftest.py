"""The test split of the tiny dataset, and answers of a known error."""

from collections.abc import Callable

import numpy as np
import pytest

from sixway.baselines.encoding import encode_target
from sixway.core.conventions import DIRECTIONS
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Sample


@pytest.fixture(scope="session")
def held_out(tiny_dataset) -> SmokeDataset:
    return SmokeDataset(tiny_dataset.folder, guide="six", split="test")


class Knows:
    """Answers every guide of a dataset with its truth, altered by `change`."""

    def __init__(self, dataset: SmokeDataset, change: Callable[[np.ndarray], np.ndarray]) -> None:
        self._answers = {}
        for row in range(len(dataset) // 2):
            pair = dataset.pair(0, row)
            self._answers[pair.guide.numpy().tobytes()] = change(encode_target(dataset, pair).copy())

    def answer(self, guide: np.ndarray, samples: tuple[Sample, ...]) -> np.ndarray:
        return self._answers[guide.tobytes()]


@pytest.fixture
def knows(held_out: SmokeDataset) -> Callable[..., Knows]:
    """Make answers of the test split: ``knows(change)``."""
    return lambda change=lambda truth: truth: Knows(held_out, change)


@pytest.fixture
def brighter() -> Callable[[np.ndarray], np.ndarray]:
    """0.1 on every map, alpha untouched."""

    def change(truth: np.ndarray) -> np.ndarray:
        truth[:, : len(DIRECTIONS)] += 0.1
        return truth

    return change
