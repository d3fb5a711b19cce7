"""The validation score: what a known error scores, overall and size by size."""

import math
from pathlib import Path
from typing import Any

import pytest
import torch

from sixway.data.dataset import SmokeDataset
from sixway.models.encoding import encode_lightmap
from sixway.training.validation import picture, validate


class Knows(torch.nn.Module):
    """Answers the truth, too bright by `error[height]`; looks it up by the guide."""

    def __init__(self, dataset: SmokeDataset, error: dict[int, float]) -> None:
        super().__init__()
        self.error = error
        self.answers = {}
        for group, described in enumerate(dataset.groups):
            for row in range(len(described.samples) // 2):
                pair = dataset.pair(group, row)
                self.answers[pair.guide.numpy().tobytes()] = encode_lightmap(pair.target, scale=dataset.scale)

    def conditioning(self, guide: torch.Tensor) -> torch.Tensor:
        return guide

    def forward(self, guide: torch.Tensor) -> torch.Tensor:
        return self.answers[guide.contiguous().numpy().tobytes()] + self.error[guide.shape[2]]


@pytest.fixture
def validation(mixed_dataset: Path) -> SmokeDataset:
    return SmokeDataset(mixed_dataset, guide="six", split="val")


def test_a_tenth_is_20_db_and_sizes_are_told_apart(validation: SmokeDataset) -> None:
    net: Any = Knows(validation, {20: 0.1, 40: 0.01})
    scores = validate(net, validation, device="cpu")
    assert scores["validation_psnr_20x24_db"] == pytest.approx(20.0, abs=1e-3)
    assert scores["validation_psnr_40x48_db"] == pytest.approx(40.0, abs=1e-3)
    together = -10.0 * math.log10((4 * 0.1**2 + 1 * 0.01**2) / 5)  # four pairs and one
    assert scores["validation_psnr_db"] == pytest.approx(together, abs=1e-3)


def test_one_size_is_told_once(tiny_dataset: Any) -> None:
    dataset = SmokeDataset(tiny_dataset.folder, guide="six", split="val")
    net: Any = Knows(dataset, {20: 0.1})
    assert validate(net, dataset, device="cpu") == {"validation_psnr_db": pytest.approx(20.0, abs=1e-3)}


def test_the_picture_shows_truth_prediction_and_their_difference(validation: SmokeDataset) -> None:
    net: Any = Knows(validation, {20: 0.1, 40: -0.05})
    pixels = picture(net, validation, device="cpu")
    small, large = 4 * 22, 4 * 42
    assert pixels.shape == (small + large, 8 * 50, 3) and pixels.dtype == "uint8"
    equal = 0.5 * 255
    difference_small, difference_large = pixels[3 * 22 : 3 * 22 + 20, :24], pixels[small + 3 * 42 : -2, :48]
    assert difference_small.mean() == pytest.approx(equal + 5 * 0.1 * 255, abs=1.0)
    assert equal - 5 * 0.05 * 255 - 1.0 < difference_large.mean() < equal  # less than no light is cut
    true = encode_lightmap(validation.pair(0, 2).target, scale=validation.scale)[0, 0]
    assert torch.equal(
        torch.from_numpy(pixels[44:64, :24, 0].copy()), (true.clamp(0.0, 1.0) * 255.0 + 0.5).to(torch.uint8)
    )
