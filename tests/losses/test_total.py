"""Weights, masks, which steps the auxiliary terms take part in, and what a run record says about the networks."""

import json
from typing import Any

import pytest
import torch
from pydantic import ValidationError
from torch import Tensor, nn

from sixway.core.color import decode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.losses.total import LossConfig, TotalLoss
from sixway.models.features import GradientFeatures
from sixway.models.flow_lucas_kanade import LucasKanade

EVERYTHING = LossConfig(mse=2.0, perceptual=0.5, flow=0.25, features="gradients", estimator="lucas_kanade")


@pytest.fixture
def frames() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(2)
    predicted, target = (torch.rand(4, 8, 24, 24, generator=generator) for _ in range(2))
    return predicted, target


def everything() -> TotalLoss:
    return TotalLoss(EVERYTHING, features=GradientFeatures(), estimator=LucasKanade())


def test_weights_apply_to_unweighted_terms(frames: tuple[Tensor, Tensor]) -> None:
    total, terms = everything()(*frames, has_emissive=True, is_pair=True, step=1)
    assert set(terms) == {"mse", "perceptual", "flow"}
    torch.testing.assert_close(total, 2.0 * terms["mse"] + 0.5 * terms["perceptual"] + 0.25 * terms["flow"])
    torch.testing.assert_close(terms["mse"], (frames[0] - frames[1]).square().mean())


def test_equal_pictures_cost_nothing(frames: tuple[Tensor, Tensor]) -> None:
    total, _ = everything()(frames[0], frames[0], has_emissive=True, is_pair=True, step=1)
    assert total == 0.0


def test_terms_of_weight_zero_are_not_computed(frames: tuple[Tensor, Tensor]) -> None:
    total, terms = TotalLoss(LossConfig())(*frames, has_emissive=True, is_pair=False, step=1)
    assert set(terms) == {"mse"} and total == terms["mse"]


def test_emissive_is_left_out_where_the_dataset_has_none(frames: tuple[Tensor, Tensor]) -> None:
    predicted, target = frames[0].clone().requires_grad_(), frames[1]
    total, _ = TotalLoss(LossConfig())(predicted, target, has_emissive=False, is_pair=False, step=0)
    total.backward()
    emissive = LIGHTMAP_CHANNELS.index("emissive")
    assert predicted.grad is not None and predicted.grad[:, emissive].abs().max() == 0.0
    kept = [i for i in range(8) if i != emissive]
    torch.testing.assert_close(total, (predicted - target)[:, kept].square().mean())


def test_linear_colour_compares_light(frames: tuple[Tensor, Tensor]) -> None:
    """Of the six maps and emissive; alpha is compared as it is."""
    loss = TotalLoss(LossConfig(colour="linear"))
    total, _ = loss(*frames, has_emissive=True, is_pair=False, step=0)
    alpha = LIGHTMAP_CHANNELS.index("alpha")
    errors = [
        (a - b if channel == alpha else decode_srgb(a) - decode_srgb(b)).square().mean()
        for channel, (a, b) in enumerate(zip(frames[0].unbind(1), frames[1].unbind(1), strict=True))
    ]
    torch.testing.assert_close(total, torch.stack(errors).mean())


def test_linear_colour_pulls_negative_answers_up() -> None:
    predicted = torch.full((1, 8, 4, 4), -0.1, requires_grad=True)
    total, _ = TotalLoss(LossConfig(colour="linear"))(
        predicted, torch.full((1, 8, 4, 4), 0.5), has_emissive=True, is_pair=False, step=0
    )
    total.backward()
    assert predicted.grad is not None and predicted.grad.max() < 0.0


def test_a_step_always_draws_the_same_triple(frames: tuple[Tensor, Tensor]) -> None:
    loss = TotalLoss(LossConfig(perceptual=1.0, features="gradients"), features=GradientFeatures())

    def perceptual(step: int) -> float:
        torch.rand(step + 1)  # the global generator must not matter
        return float(loss(*frames, has_emissive=True, is_pair=False, step=step)[1]["perceptual"])

    drawn = [perceptual(step) for step in range(20)]
    assert drawn == [perceptual(step) for step in range(20)]
    assert len(set(drawn)) == 2


class Chroma(nn.Module):
    """Features with a random gain of their own for each colour, so that the two triples give different gradients."""

    name = "gradients"
    pretrained = False

    def forward(self, picture: Tensor) -> list[Tensor]:
        return [picture * torch.tensor([1.0, 2.0, 4.0]).reshape(1, 3, 1, 1)]


@pytest.mark.parametrize("every", [1, 4])
def test_the_auxiliary_gradient_is_unbiased(frames: tuple[Tensor, Tensor], every: int) -> None:
    """Over many steps: that of the mean over both triples, whichever triple a step drew and however many it sat out."""
    steps = 1000
    config = LossConfig(perceptual=1.0, features="gradients", auxiliary_every=every)
    loss = TotalLoss(config, features=Chroma())
    small = [frame[:1, :, :3, :3] for frame in frames]
    predicted = small[0].clone().requires_grad_()
    mse = TotalLoss(LossConfig())(predicted, small[1], has_emissive=True, is_pair=False, step=0)[0]
    (mse_gradient,) = torch.autograd.grad(mse, predicted)
    total = torch.stack(
        [loss(predicted, small[1], has_emissive=True, is_pair=False, step=step)[0] for step in range(steps)]
    ).mean()
    (gradient,) = torch.autograd.grad(total, predicted)
    assert loss.perceptual is not None
    both = torch.stack([loss.perceptual(predicted, small[1], triple=triple) for triple in (0, 1)]).mean()
    (expected,) = torch.autograd.grad(both, predicted)
    # a coin thrown steps / every times: five standard errors of its share
    torch.testing.assert_close(gradient - mse_gradient, expected, rtol=5.0 * (every / steps) ** 0.5, atol=1e-5)


def test_auxiliary_terms_every_other_step_count_twice(frames: tuple[Tensor, Tensor]) -> None:
    config = EVERYTHING.model_copy(update={"auxiliary_every": 2})
    loss = TotalLoss(config, features=GradientFeatures(), estimator=LucasKanade())
    total, terms = loss(*frames, has_emissive=True, is_pair=True, step=0)
    assert set(terms) == {"mse"} and total == 2.0 * terms["mse"]
    total, terms = loss(*frames, has_emissive=True, is_pair=True, step=1)
    torch.testing.assert_close(total, 2.0 * terms["mse"] + 2.0 * (0.5 * terms["perceptual"] + 0.25 * terms["flow"]))


def test_a_log_of_every_fourth_step_shows_every_term() -> None:
    loss = TotalLoss(LossConfig(auxiliary_every=4, auxiliary_from=0.5), steps=16)
    assert [step for step in range(16) if loss.sees_auxiliary(step)] == [11, 15]  # (step + 1) % 4 == 0 is logged


@pytest.mark.parametrize(("share", "steps", "first"), [(0.0, 10, 0), (0.5, 10, 5), (0.7, 10, 7), (0.25, 10, 3)])
def test_auxiliary_terms_begin_after_their_share_of_the_run(share: float, steps: int, first: int) -> None:
    loss = TotalLoss(LossConfig(auxiliary_from=share), steps=steps)
    assert [loss.sees_auxiliary(step) for step in range(steps)] == [step >= first for step in range(steps)]
    assert loss.describe()["auxiliary"] == {"every": 1, "first_step": first}


def test_a_share_of_a_run_needs_its_length() -> None:
    with pytest.raises(ValueError, match="number of steps"):
        TotalLoss(LossConfig(auxiliary_from=0.5))


def test_a_known_flow_is_not_estimated_again(frames: tuple[Tensor, Tensor]) -> None:
    loss = TotalLoss(LossConfig(flow=1.0, estimator="lucas_kanade"), estimator=LucasKanade())
    lit = frames[1][:, :6].mean(dim=1, keepdim=True)
    known = LucasKanade()(lit[0::2], lit[1::2])
    options: dict[str, Any] = {"has_emissive": True, "is_pair": True, "step": 0}
    estimated = loss(*frames, **options)[1]["flow"]
    torch.testing.assert_close(loss(*frames, **options, true_flow=known)[1]["flow"], estimated)
    assert loss(*frames, **options, true_flow=known + 1.0)[1]["flow"] != estimated


def test_half_precision_is_lifted(frames: tuple[Tensor, Tensor]) -> None:
    total, _ = everything()(frames[0].bfloat16(), frames[1], has_emissive=True, is_pair=True, step=1)
    assert total.dtype == torch.float32


def test_flow_without_pairs_is_an_error(frames: tuple[Tensor, Tensor]) -> None:
    with pytest.raises(ValueError, match="consecutive"):
        everything()(*frames, has_emissive=True, is_pair=False, step=1)


@pytest.mark.parametrize(
    ("values", "remedy"),
    [
        ({"perceptual": 0.1}, "features: efficientnet_lite0, vgg16 or gradients"),
        ({"flow": 0.1}, "estimator: flownet or lucas_kanade"),
        ({"features": "gradients", "vgg_weights": "vgg16.pth"}, "set features: vgg16"),
        ({"mse": 0.0}, "mse: 1"),
        ({"mse": 0.0, "perceptual": 1.0, "features": "gradients", "auxiliary_every": 2}, "auxiliary_every: 1"),
        ({"mse": 0.0, "perceptual": 1.0, "features": "gradients", "auxiliary_from": 0.5}, "auxiliary_from: 0"),
        ({"auxiliary_every": 0}, "greater than or equal to 1"),
        ({"auxiliary_from": 1.0}, "less than 1"),
        ({"mse": -1.0}, "greater than or equal to 0"),
    ],
)
def test_a_config_that_cannot_work_names_the_remedy(values: dict[str, Any], remedy: str) -> None:
    with pytest.raises(ValidationError, match=remedy):
        LossConfig.model_validate(values)


def test_a_missing_or_other_network_is_an_error() -> None:
    with pytest.raises(ValueError, match="features: gradients"):
        TotalLoss(EVERYTHING, estimator=LucasKanade())


def test_a_record_says_which_networks_are_not_pretrained() -> None:
    record = json.loads(json.dumps(everything().describe()))
    assert record["mse"] == {"weight": 2.0}
    assert record["perceptual"]["network"] == "gradients" and record["perceptual"]["pretrained"] is False
    assert "NO pretrained" in record["flow"]["note"]
    plain = TotalLoss(LossConfig()).describe()
    assert plain["colour"] == "srgb"
    assert plain["perceptual"] == {"weight": 0.0, "network": "none", "pretrained": False, "note": "term not used"}
