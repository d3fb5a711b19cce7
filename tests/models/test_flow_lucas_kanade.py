"""Lucas-Kanade against translations that are known."""

import pytest
import torch
from torch import Tensor

from sixway.models.flow_lucas_kanade import LucasKanade
from sixway.models.flow_warp import warp


def puffs(*, right: float = 0.0, down: float = 0.0, height: int = 88, width: int = 96) -> Tensor:
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


@pytest.mark.parametrize("motion", [(1.0, 0.0), (0.5, -1.5), (-2.8, 2.8), (4.0, 0.0), (0.0, -4.0)])
def test_a_known_translation(motion: tuple[float, float], device: str) -> None:
    first, second = puffs().to(device), puffs(right=motion[0], down=motion[1]).to(device)
    flow = LucasKanade()(first, second)
    endpoint_error = (flow - flow.new_tensor(motion).reshape(1, 2, 1, 1)).norm(dim=1, keepdim=True)
    assert endpoint_error[first > 0.05].mean() < 0.5
    assert (warp(second, flow) - first).abs().mean() < 0.2 * (second - first).abs().mean()


def test_no_motion_is_no_flow() -> None:
    assert LucasKanade()(puffs(), puffs()).abs().max() < 1e-4


def test_black_pictures_have_no_flow_and_finite_gradients() -> None:
    first, second = torch.zeros(1, 1, 33, 20, requires_grad=True), torch.zeros(1, 1, 33, 20, requires_grad=True)
    flow = LucasKanade()(first, second)
    flow.abs().sum().backward()
    assert flow.abs().max() == 0.0
    for picture in (first, second):
        assert picture.grad is not None and torch.isfinite(picture.grad).all()


def test_flow_is_differentiable() -> None:
    second = puffs(right=1.0).requires_grad_()
    LucasKanade()(puffs(), second)[:, 0].mean().backward()
    assert second.grad is not None and torch.isfinite(second.grad).all() and second.grad.abs().max() > 0.0


def test_brightness_does_not_matter_where_the_smoke_is() -> None:
    first, second = puffs(), puffs(right=1.5, down=1.0)
    difference = LucasKanade()(0.1 * first, 0.1 * second) - LucasKanade()(first, second)
    assert difference.abs()[(first > 0.1).expand(-1, 2, -1, -1)].mean() < 0.1


def test_warp_by_a_whole_pixel_is_a_shift() -> None:
    picture = torch.rand(1, 2, 7, 9)
    flow = torch.zeros(1, 2, 7, 9)
    flow[:, 0], flow[:, 1] = 2.0, -1.0
    torch.testing.assert_close(warp(picture, flow)[:, :, 1:, :-2], picture[:, :, :-1, 2:])


@pytest.mark.parametrize("wrong", [{"levels": 0}, {"iterations": 0}, {"window_px": 0.0}])
def test_settings_that_make_no_sense(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="Lucas-Kanade"):
        LucasKanade(**wrong)
