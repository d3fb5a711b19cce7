"""Lucas-Kanade against translations that are known."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from sixway.models.flow_lucas_kanade import LucasKanade
from sixway.models.flow_warp import warp


@pytest.mark.parametrize("motion", [(1.0, 0.0), (0.5, -1.5), (-2.8, 2.8), (4.0, 0.0), (0.0, -4.0)])
def test_a_known_translation(motion: tuple[float, float], device: str, puffs: Callable[..., Tensor]) -> None:
    first, second = puffs().to(device), puffs(right=motion[0], down=motion[1]).to(device)
    flow = LucasKanade()(first, second)
    endpoint_error = (flow - flow.new_tensor(motion).reshape(1, 2, 1, 1)).norm(dim=1, keepdim=True)
    assert endpoint_error[first > 0.05].mean() < 0.5
    assert (warp(second, flow) - first).abs().mean() < 0.2 * (second - first).abs().mean()


def test_no_motion_is_no_flow(puffs: Callable[..., Tensor]) -> None:
    assert LucasKanade()(puffs(), puffs()).abs().max() < 1e-4


def test_black_pictures_have_no_flow_and_finite_gradients() -> None:
    first, second = torch.zeros(1, 1, 33, 20, requires_grad=True), torch.zeros(1, 1, 33, 20, requires_grad=True)
    flow = LucasKanade()(first, second)
    flow.abs().sum().backward()
    assert flow.abs().max() == 0.0
    for picture in (first, second):
        assert picture.grad is not None and torch.isfinite(picture.grad).all()


def test_flow_is_differentiable(puffs: Callable[..., Tensor]) -> None:
    second = puffs(right=1.0).requires_grad_()
    LucasKanade()(puffs(), second)[:, 0].mean().backward()
    assert second.grad is not None and torch.isfinite(second.grad).all() and second.grad.abs().max() > 0.0


def test_brightness_does_not_matter_where_the_smoke_is(puffs: Callable[..., Tensor]) -> None:
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
