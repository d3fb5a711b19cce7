"""The flow loss: cached flows, what it leaves out, and its gradient."""

import pytest
import torch
from torch import Tensor, nn

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.losses.flow import FlowLoss
from sixway.models.flow_lucas_kanade import LucasKanade
from sixway.models.flownet import load_flownet

_ALPHA = LIGHTMAP_CHANNELS.index("alpha")


class BrightnessFlow(nn.Module):
    """An estimator that can be worked out by hand: the flow is the brightness of the first picture, both ways."""

    name = "brightness"
    pretrained = False

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        return first.expand(-1, 2, -1, -1)


def frames(*brightness: float, size: int = 16) -> Tensor:
    """Even pictures, opaque everywhere."""
    return torch.stack([torch.full((8, size, size), value) for value in brightness]).index_fill(
        1, torch.tensor([_ALPHA]), 1.0
    )


def puff_pair(*, right_px: float) -> Tensor:
    """Two pairs of a round puff that moves to the right; [4, 8, 48, 48]."""
    y, x = torch.meshgrid(torch.arange(48.0), torch.arange(48.0), indexing="ij")
    pictures = [
        torch.exp(-((x - 22.0 - shift) ** 2 + (y - 24.0) ** 2) / 40.0)
        + 0.3 * torch.exp(-((x - 26.0 - shift) ** 2) / 9.0)
        for shift in (0.0, right_px, 0.0, right_px)
    ]
    return torch.stack(pictures)[:, None].expand(-1, 8, -1, -1).clamp(0.0, 1.0).clone()


def test_a_kept_flow_gives_what_finding_it_again_gives() -> None:
    loss, target, predicted = FlowLoss(LucasKanade()), puff_pair(right_px=1.5), puff_pair(right_px=0.5)
    kept = loss.flow_of(target)
    assert kept.shape == (2, 2, 48, 48)
    found = loss(predicted, target)
    torch.testing.assert_close(loss(predicted, target, kept), found)
    assert found == pytest.approx(0.5, abs=0.25)  # mean of 1 px to the right and 0 px down
    assert loss(predicted, target, kept + 3.0) > found


def test_opacity_weighs_the_pixels() -> None:
    target = frames(0.5, 0.5)
    target[0, _ALPHA, :, :8] = 0.25
    predicted = target.clone()
    predicted[0, :6, :, :8] += 0.4
    # 0.4 px wrong on a weight of 0.25, right on a weight of 1
    assert FlowLoss(BrightnessFlow())(predicted, target) == pytest.approx(0.4 * 0.25 / 1.25)


def test_black_has_no_flow_to_compare() -> None:
    estimator = FlowLoss(BrightnessFlow())
    half_black = frames(0.5, 0.5)
    half_black[0, :6, :, :8] = 0.0
    predicted = half_black + 0.1
    assert estimator(predicted, half_black) == pytest.approx(0.1)
    gone = frames(0.5, 0.0, 0.5, 0.5)  # the second frame of the first pair is black
    wrong = gone.clone()
    wrong[0, :6] = 0.9
    assert estimator(wrong, gone) == 0.0
    wrong[2, :6] = 0.7
    assert estimator(wrong, gone) == pytest.approx(0.2)


@pytest.mark.parametrize("estimator", [LucasKanade(), load_flownet()], ids=["lucas_kanade", "flownet"])
def test_real_estimators_tell_wrong_motion_and_say_how_to_mend_it(estimator: nn.Module) -> None:
    loss, target = FlowLoss(estimator), puff_pair(right_px=2.0)  # type: ignore[arg-type]
    still = puff_pair(right_px=0.0).requires_grad_()
    wrong = loss(still, target)
    assert wrong > 5.0 * loss(target + 1e-3, target)
    wrong.backward()
    assert still.grad is not None and torch.isfinite(still.grad).all()
    step = still.detach() - 1e-3 * still.grad / still.grad.abs().max()
    assert loss(step, target) < wrong


@pytest.mark.parametrize("estimator", [LucasKanade(), load_flownet()], ids=["lucas_kanade", "flownet"])
def test_black_frames_cost_nothing_and_break_nothing(estimator: nn.Module) -> None:
    black = torch.zeros(2, 8, 32, 32)
    predicted = black.clone().requires_grad_()
    loss = FlowLoss(estimator)(predicted, black)  # type: ignore[arg-type]
    loss.backward()
    assert loss == 0.0 and predicted.grad is not None and predicted.grad.abs().max() == 0.0


def test_pairs_are_needed() -> None:
    with pytest.raises(ValueError, match="3 frames"):
        FlowLoss(BrightnessFlow())(frames(0.1, 0.2, 0.3), frames(0.1, 0.2, 0.3))
    with pytest.raises(ValueError, match="2 flows for 2 frames"):
        FlowLoss(BrightnessFlow())(frames(0.1, 0.2), frames(0.1, 0.2), torch.zeros(2, 2, 16, 16))
