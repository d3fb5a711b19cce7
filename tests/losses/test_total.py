"""Weights, masks, and what a run record says about the networks."""

import json
from typing import Any

import pytest
import torch
from pydantic import ValidationError
from torch import Tensor

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.losses.total import LossConfig, TotalLoss
from sixway.models.features import GradientFeatures
from sixway.models.flownet import LucasKanade

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


def test_a_step_always_draws_the_same_triple(frames: tuple[Tensor, Tensor]) -> None:
    loss = TotalLoss(LossConfig(perceptual=1.0, features="gradients"), features=GradientFeatures())

    def perceptual(step: int) -> float:
        torch.rand(step + 1)  # the global generator must not matter
        return float(loss(*frames, has_emissive=True, is_pair=False, step=step)[1]["perceptual"])

    drawn = [perceptual(step) for step in range(20)]
    assert drawn == [perceptual(step) for step in range(20)]
    assert len(set(drawn)) == 2


def test_half_precision_is_lifted(frames: tuple[Tensor, Tensor]) -> None:
    total, _ = everything()(frames[0].bfloat16(), frames[1], has_emissive=True, is_pair=True, step=1)
    assert total.dtype == torch.float32


def test_flow_without_pairs_is_an_error(frames: tuple[Tensor, Tensor]) -> None:
    with pytest.raises(ValueError, match="consecutive"):
        everything()(*frames, has_emissive=True, is_pair=False, step=1)


@pytest.mark.parametrize(
    ("values", "remedy"),
    [
        ({"perceptual": 0.1}, "features: gradients"),
        ({"flow": 0.1}, "estimator: lucas_kanade"),
        ({"mse": 0.0}, "mse: 1"),
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
    assert plain["perceptual"] == {"weight": 0.0, "network": "none", "pretrained": False, "note": "term not used"}
