"""The training loss: named terms, and the one place where their weights apply.

Weights are chosen by the size of gradients, not of values, whose units differ: each auxiliary term
should pull at the net about a tenth as hard as the squared error does. `scripts/balance_losses.py CONFIG`
measures that on real batches and suggests weights. Squared error fades faster than the others as the net
learns, so measure with a trained net (`--net RUN`), else the auxiliary terms take over near the end.
"""

import math
from typing import Annotated, Any, Literal

import torch
from jaxtyping import Float
from pydantic import Field, model_validator
from torch import Tensor, nn

from sixway.core.config import Config
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.losses.flow import FlowEstimator, FlowLoss
from sixway.losses.perceptual import FeatureExtractor, PerceptualLoss, random_triple
from sixway.losses.pixel import linear_light, masked_mse

Weight = Annotated[float, Field(ge=0.0)]


class LossConfig(Config):
    """Weights of the terms, and the networks that they look through."""

    mse: Weight = 1.0
    perceptual: Weight = 0.0
    """Together with `flow` the auxiliary terms. A weight of 0 switches a term off."""
    flow: Weight = 0.0
    colour: Literal["srgb", "linear"] = "srgb"
    """Where the squared error is taken: of the sRGB code, or of linear light (the paper's ablation)."""
    features: Literal["none", "gradients", "vgg16", "efficientnet_lite0"] = "none"
    """What the perceptual term sees with; `gradients` has no weights and is no pretrained net."""
    vgg_weights: str | None = None
    """File with torchvision's weights of VGG16; None downloads them once into torch's cache."""
    estimator: Literal["none", "lucas_kanade", "flownet"] = "none"
    """What the flow term sees motion with; `lucas_kanade` has no weights and is no pretrained net."""
    auxiliary_every: int = Field(default=1, ge=1)
    """The auxiliary terms are computed on every n-th step only and count n times there."""
    auxiliary_from: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Share of the run after which the auxiliary terms begin."""

    @model_validator(mode="after")
    def _weighted_terms_have_networks(self) -> "LossConfig":
        if self.perceptual > 0.0 and self.features == "none":
            raise ValueError(
                f"perceptual: {self.perceptual} has nothing to see with; set features: efficientnet_lite0, vgg16 or "
                "gradients, or perceptual: 0"
            )
        if self.flow > 0.0 and self.estimator == "none":
            raise ValueError(
                f"flow: {self.flow} has nothing to estimate flow with; set estimator: flownet or lucas_kanade, "
                "or flow: 0"
            )
        if self.vgg_weights is not None and self.features != "vgg16":
            raise ValueError(f"vgg_weights: features: {self.features} reads none; set features: vgg16, or leave it out")
        return self

    @model_validator(mode="after")
    def _every_step_has_a_term(self) -> "LossConfig":
        if self.mse == self.perceptual == self.flow == 0.0:
            raise ValueError("every weight is 0, so nothing would be learnt; set mse: 1")
        if self.mse == 0.0 and (self.auxiliary_every > 1 or self.auxiliary_from > 0.0):
            raise ValueError(
                f"mse: 0 with auxiliary_every: {self.auxiliary_every} and auxiliary_from: {self.auxiliary_from} leaves "
                "steps with nothing to learn from; set mse: 1, or auxiliary_every: 1 and auxiliary_from: 0"
            )
        return self


class TotalLoss(nn.Module):
    """Weighted sum of squared error, perceptual distance and flow distance.

    features, estimator: what `config` names, built by the caller; a term of weight 0 needs none and is
    not computed. steps: length of the run, which `auxiliary_from` is a share of.
    Raises ValueError if a weighted term lacks its network, the network goes by another name, or
    `auxiliary_from` is set without `steps`.
    """

    without_emissive: Tensor

    def __init__(
        self,
        config: LossConfig,
        *,
        steps: int | None = None,
        features: FeatureExtractor | None = None,
        estimator: FlowEstimator | None = None,
    ) -> None:
        super().__init__()
        _check_network("features", config.features, features, weight=config.perceptual)
        _check_network("estimator", config.estimator, estimator, weight=config.flow)
        if config.auxiliary_from > 0.0 and steps is None:
            raise ValueError(f"auxiliary_from: {config.auxiliary_from} is a share of a run; pass its number of steps")
        self.config = config
        self.auxiliary_first = math.ceil(config.auxiliary_from * (steps or 0))
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
        true_flow: Float[Tensor, "p 2 h w"] | None = None,
    ) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
        """The weighted sum, and the unweighted terms of this step by name (detached, for the log).

        Both pictures: what the net answers, sRGB-encoded light and linear alpha, in `LIGHTMAP_CHANNELS`
        order. has_emissive: False leaves the emissive channel out. is_pair: the batch is consecutive
        frames [a0, a1, b0, b1, ...]; the flow term needs them and raises ValueError otherwise. step:
        counts from 0, decides whether the auxiliary terms take part, and seeds the choice of the
        perceptual triple, so that a resumed run makes the same choices. true_flow: what the estimator
        says of the target pairs [px; right, down], if that is known already.
        """
        if self.flow is not None and not is_pair:
            raise ValueError(
                f"flow: {self.config.flow} needs batches of consecutive frames; load frame pairs, or set flow: 0"
            )
        # a half-precision difference of two nearly equal pictures has few bits left
        predicted, target = predicted.float(), target.float()
        terms: dict[str, Tensor] = {}
        if self.config.mse > 0.0:
            terms["mse"] = self._squared_error(predicted, target, has_emissive=has_emissive)
        if self.sees_auxiliary(step):
            if self.perceptual is not None:
                triple = random_triple(torch.Generator().manual_seed(step))
                terms["perceptual"] = self.perceptual(predicted, target, triple=triple)
            if self.flow is not None:
                terms["flow"] = self.flow(predicted, target, true_flow)

        auxiliary = self.config.auxiliary_every  # as often as the term is left out, so much more it counts
        factors = {
            "mse": self.config.mse,
            "perceptual": auxiliary * self.config.perceptual,
            "flow": auxiliary * self.config.flow,
        }
        total = torch.stack([factors[name] * term for name, term in terms.items()]).sum()
        return total, {name: term.detach() for name, term in terms.items()}

    def sees_auxiliary(self, step: int) -> bool:
        """Whether the auxiliary terms take part in this step (from 0): the n-th, 2n-th, ... of the run are theirs.

        A log written on every n-th step shows them each time.
        """
        return step >= self.auxiliary_first and (step + 1) % self.config.auxiliary_every == 0

    def describe(self) -> dict[str, Any]:
        """What a run record keeps: every term's weight, and which network stands behind it."""
        return {
            "mse": {"weight": self.config.mse},
            "colour": self.config.colour,
            "perceptual": {
                "weight": self.config.perceptual,
                **_describe_network(None if self.perceptual is None else self.perceptual.features),
            },
            "flow": {
                "weight": self.config.flow,
                **_describe_network(None if self.flow is None else self.flow.estimator),
            },
            "auxiliary": {"every": self.config.auxiliary_every, "first_step": self.auxiliary_first},
        }

    def _squared_error(self, predicted: Tensor, target: Tensor, *, has_emissive: bool) -> Tensor:
        if self.config.colour == "linear":
            predicted, target = linear_light(predicted), linear_light(target)
        weights = torch.ones_like(self.without_emissive) if has_emissive else self.without_emissive
        return masked_mse(predicted, target, channel_weights=weights)


def _check_network(role: str, wanted: str, given: FeatureExtractor | FlowEstimator | None, *, weight: float) -> None:
    name = "none" if given is None else given.name
    if weight > 0.0 and name != wanted:
        raise ValueError(f"the config asks for {role}: {wanted}, but {name!r} was passed; build what the config names")


def _describe_network(network: FeatureExtractor | FlowEstimator | None) -> dict[str, Any]:
    if network is None:
        return {"network": "none", "pretrained": False, "note": "term not used"}
    note = "pretrained" if network.pretrained else "weight-free stand-in; NO pretrained network was used"
    return {"network": network.name, "pretrained": network.pretrained, "note": note}
