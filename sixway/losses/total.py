"""The training loss: named terms, and the one place where their weights apply."""

from typing import Annotated, Any, Literal

import torch
from jaxtyping import Float
from pydantic import Field, model_validator
from torch import Tensor, nn

from sixway.core.config import Config
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.losses.flow import FlowEstimator, FlowLoss
from sixway.losses.perceptual import FeatureExtractor, PerceptualLoss, random_triple
from sixway.losses.pixel import masked_mse

Weight = Annotated[float, Field(ge=0.0)]


class LossConfig(Config):
    """Weights of the terms, and the networks that they look through.

    mse, perceptual, flow: weights, 0 switches a term off. features: what the perceptual term sees
    with; `gradients` has no weights and is no pretrained net. estimator: likewise for the flow term.
    """

    mse: Weight = 1.0
    perceptual: Weight = 0.0
    flow: Weight = 0.0
    features: Literal["none", "gradients"] = "none"
    estimator: Literal["none", "lucas_kanade"] = "none"

    @model_validator(mode="after")
    def _weighted_terms_have_networks(self) -> "LossConfig":
        if self.perceptual > 0.0 and self.features == "none":
            raise ValueError(
                f"perceptual: {self.perceptual} has nothing to see with; set features: gradients, or perceptual: 0"
            )
        if self.flow > 0.0 and self.estimator == "none":
            raise ValueError(
                f"flow: {self.flow} has nothing to estimate flow with; set estimator: lucas_kanade, or flow: 0"
            )
        if self.mse == self.perceptual == self.flow == 0.0:
            raise ValueError("every weight is 0, so nothing would be learnt; set mse: 1")
        return self


class TotalLoss(nn.Module):
    """Weighted sum of squared error, perceptual distance and flow distance.

    features, estimator: what `config` names, built by the caller; ValueError if a weighted term lacks
    its network or the network goes by another name. A term of weight 0 is not computed.
    """

    without_emissive: Tensor

    def __init__(
        self,
        config: LossConfig,
        *,
        features: FeatureExtractor | None = None,
        estimator: FlowEstimator | None = None,
    ) -> None:
        super().__init__()
        _check_network("features", config.features, features, weight=config.perceptual)
        _check_network("estimator", config.estimator, estimator, weight=config.flow)
        self.config = config
        self.perceptual = PerceptualLoss(features) if features is not None and config.perceptual > 0.0 else None
        self.flow = FlowLoss(estimator) if estimator is not None and config.flow > 0.0 else None
        counted = [float(channel != "emissive") for channel in LIGHTMAP_CHANNELS]
        self.register_buffer("without_emissive", torch.tensor(counted), persistent=False)

    def forward(
        self,
        predicted: Float[Tensor, "n 8 h w"],
        target: Float[Tensor, "n 8 h w"],
        *,
        has_emissive: bool,
        is_pair: bool,
        step: int,
    ) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
        """The weighted sum, and the unweighted terms by name (detached, for the log).

        Both pictures: what the net answers, sRGB-encoded light and linear alpha, in `LIGHTMAP_CHANNELS`
        order. has_emissive: False leaves the emissive channel out. is_pair: the batch is consecutive
        frames [a0, a1, b0, b1, ...]; the flow term needs them and raises ValueError otherwise. step:
        seeds the choice of the perceptual triple, so that a resumed run makes the same choices.
        """
        # a half-precision difference of two nearly equal pictures has few bits left
        predicted, target = predicted.float(), target.float()
        weights = torch.ones_like(self.without_emissive) if has_emissive else self.without_emissive
        terms: dict[str, Tensor] = {}
        if self.config.mse > 0.0:
            terms["mse"] = masked_mse(predicted, target, channel_weights=weights)
        if self.perceptual is not None:
            triple = random_triple(torch.Generator().manual_seed(step))
            terms["perceptual"] = self.perceptual(predicted, target, triple=triple)
        if self.flow is not None:
            if not is_pair:
                raise ValueError(
                    f"flow: {self.config.flow} needs batches of consecutive frames; load frame pairs, or set flow: 0"
                )
            terms["flow"] = self.flow(predicted, target)

        factors = {"mse": self.config.mse, "perceptual": self.config.perceptual, "flow": self.config.flow}
        total = torch.stack([factors[name] * term for name, term in terms.items()]).sum()
        return total, {name: term.detach() for name, term in terms.items()}

    def describe(self) -> dict[str, Any]:
        """What a run record keeps: every term's weight, and which network stands behind it."""
        return {
            "mse": {"weight": self.config.mse},
            "perceptual": {
                "weight": self.config.perceptual,
                **_describe_network(None if self.perceptual is None else self.perceptual.features),
            },
            "flow": {
                "weight": self.config.flow,
                **_describe_network(None if self.flow is None else self.flow.estimator),
            },
        }


def _check_network(role: str, wanted: str, given: FeatureExtractor | FlowEstimator | None, *, weight: float) -> None:
    name = "none" if given is None else given.name
    if weight > 0.0 and name != wanted:
        raise ValueError(f"the config asks for {role}: {wanted}, but {name!r} was passed; build what the config names")


def _describe_network(network: FeatureExtractor | FlowEstimator | None) -> dict[str, Any]:
    if network is None:
        return {"network": "none", "pretrained": False, "note": "term not used"}
    note = "pretrained" if network.pretrained else "weight-free stand-in; NO pretrained network was used"
    return {"network": network.name, "pretrained": network.pretrained, "note": note}
