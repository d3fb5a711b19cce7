"""What the tests of flow estimators share."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor


def _puffs(*, right: float = 0.0, down: float = 0.0, height: int = 88, width: int = 96) -> Tensor:
    """A smooth, smoke-like picture, moved by that many px; [1, 1, h, w] in about [0, 1]."""
    generator = torch.Generator().manual_seed(4)
    y = torch.arange(float(height))[:, None] - down
    x = torch.arange(float(width))[None, :] - right
    picture = torch.zeros(height, width)
    for _ in range(25):
        u, v, size, weight = torch.rand(4, generator=generator).tolist()
        centre_x, centre_y, radius = (0.2 + 0.6 * u) * width, (0.2 + 0.6 * v) * height, 3.0 + 8.0 * size
        picture = picture + weight * torch.exp(-((x - centre_x) ** 2 + (y - centre_y) ** 2) / (2.0 * radius**2))
    return (picture / 3.0)[None, None]


@pytest.fixture
def puffs() -> Callable[..., Tensor]:
    """`_puffs`: pictures whose motion is known."""
    return _puffs
