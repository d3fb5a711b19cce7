"""Every term: zero for equal pictures, positive for others, finite in the dark."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.losses.flow import FlowLoss
from sixway.losses.perceptual import TRIPLES, PerceptualLoss, random_triple
from sixway.losses.pixel import masked_mse
from sixway.models.features import GradientFeatures
from sixway.models.flownet import LucasKanade

Term = Callable[[Tensor, Tensor], Tensor]

TERMS: dict[str, Term] = {
    "mse": lambda predicted, target: masked_mse(predicted, target, channel_weights=torch.ones(8)),
    "perceptual": lambda predicted, target: PerceptualLoss(GradientFeatures())(predicted, target, triple=0),
    "flow": FlowLoss(LucasKanade()),
}


@pytest.fixture
def pair() -> Tensor:
    """Two consecutive frames of a moving puff, [2, 8, 32, 32]."""
    y, x = torch.arange(32.0)[:, None], torch.arange(32.0)[None, :]
    frames = [torch.exp(-((x - 14.0 - shift) ** 2 + (y - 16.0) ** 2) / 40.0) for shift in (0.0, 1.0)]
    return torch.stack(frames)[:, None].repeat(1, 8, 1, 1)


@pytest.mark.parametrize("name", TERMS)
def test_equal_pictures_cost_nothing(name: str, pair: Tensor) -> None:
    assert TERMS[name](pair, pair) == 0.0


@pytest.mark.parametrize("name", TERMS)
def test_different_pictures_cost_something(name: str, pair: Tensor) -> None:
    assert TERMS[name](pair.flip(0), pair) > 1e-4


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("black", ["both", "target", "predicted"])
def test_gradients_are_finite_on_black_frames(name: str, black: str, pair: Tensor) -> None:
    predicted = (pair if black == "target" else torch.zeros_like(pair)).clone().requires_grad_()
    target = pair if black == "predicted" else torch.zeros_like(pair)
    loss = TERMS[name](predicted, target)
    loss.backward()
    assert torch.isfinite(loss)
    assert predicted.grad is not None and torch.isfinite(predicted.grad).all()


def test_mse_against_its_formula() -> None:
    predicted, target = torch.rand(3, 2, 4, 5), torch.rand(3, 2, 4, 5)
    mask = (torch.rand(3, 1, 4, 5) > 0.5).float()
    squared = (predicted - target).square()
    inside = mask.bool().expand_as(squared)
    expected = (1.0 * squared[:, 0][inside[:, 0]].mean() + 3.0 * squared[:, 1][inside[:, 1]].mean()) / 4.0
    weighted = masked_mse(predicted, target, channel_weights=torch.tensor([1.0, 3.0]), mask=mask)
    torch.testing.assert_close(weighted, expected)
    everywhere = masked_mse(predicted, target, channel_weights=torch.ones(2))
    torch.testing.assert_close(everywhere, squared.mean())


def test_mse_where_nothing_counts_is_zero() -> None:
    loss = masked_mse(
        torch.rand(1, 2, 4, 4), torch.rand(1, 2, 4, 4), channel_weights=torch.ones(2), mask=torch.zeros(1, 1, 4, 4)
    )
    assert loss == 0.0


def test_triples_hold_every_direction_once() -> None:
    assert sorted(TRIPLES[0] + TRIPLES[1]) == sorted(DIRECTIONS)


@pytest.mark.parametrize("triple", range(len(TRIPLES)))
def test_a_triple_sees_its_own_maps_only(triple: int, pair: Tensor) -> None:
    predicted = (0.5 * pair).requires_grad_()
    PerceptualLoss(GradientFeatures())(predicted, pair, triple=triple).backward()
    assert predicted.grad is not None
    seen = [name for name, g in zip(LIGHTMAP_CHANNELS, predicted.grad.abs().sum(dim=(0, 2, 3)), strict=True) if g > 0]
    assert sorted(seen) == sorted(TRIPLES[triple])


def test_triples_are_drawn_from_the_generator_alone() -> None:
    def draws(seed: int) -> list[int]:
        generator = torch.Generator().manual_seed(seed)
        return [random_triple(generator) for _ in range(40)]

    assert draws(3) == draws(3) != draws(4)
    assert set(draws(3)) == set(range(len(TRIPLES)))


class ConstantFlow(nn.Module):
    """An estimator whose flow is the brightness of the first picture, so that the loss has a closed form."""

    name = "constant"
    pretrained = True

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        return first.expand(-1, 2, -1, -1)


def test_flow_is_compared_where_the_smoke_is() -> None:
    target = torch.zeros(2, 8, 8, 8)
    target[0, LIGHTMAP_CHANNELS.index("alpha"), :4] = 1.0
    predicted = torch.zeros(2, 8, 8, 8)
    predicted[0, :6, :2] = 0.5
    predicted[0, :6, 4:] = 9.0
    assert FlowLoss(ConstantFlow())(predicted, target) == pytest.approx(0.25)


def test_an_odd_batch_is_no_batch_of_pairs() -> None:
    with pytest.raises(ValueError, match="pairs"):
        FlowLoss(LucasKanade())(torch.zeros(3, 8, 16, 16), torch.zeros(3, 8, 16, 16))
