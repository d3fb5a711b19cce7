"""Gradient features against pictures whose gradients are known."""

import pytest
import torch

from sixway.models.features import GradientFeatures


def test_gradient_features_of_a_ramp() -> None:
    ramp = (0.01 * torch.arange(32.0)).expand(1, 3, 32, 32)
    features = GradientFeatures(levels=2)(ramp)
    assert [tuple(level.shape) for level in features] == [(1, 6, 32, 32), (1, 6, 16, 16)]
    for level, slope in zip(features, (0.01, 0.02), strict=True):
        expected = torch.tensor([slope, 0.0]).repeat(3).reshape(1, 6, 1, 1).expand(1, 6, 4, 4)
        torch.testing.assert_close(level[:, :, 6:10, 6:10], expected, rtol=1e-4, atol=1e-6)


def test_gradient_features_say_that_they_are_not_pretrained() -> None:
    assert GradientFeatures.pretrained is False and not list(GradientFeatures().parameters())


@pytest.mark.parametrize("size", [(1, 1), (5, 9), (64, 12)])
def test_gradient_features_of_small_pictures(size: tuple[int, int]) -> None:
    features = GradientFeatures(levels=4)(torch.rand(1, 3, *size))
    assert 1 <= len(features) <= 4 and all(torch.isfinite(level).all() for level in features)
