"""From names in a config to the networks that losses look through; the one place that knows both rooms."""

from pathlib import Path

from sixway.losses.flow import FlowEstimator
from sixway.losses.perceptual import FeatureExtractor
from sixway.losses.total import LossConfig, TotalLoss
from sixway.models.efficientnet import EfficientNetLite0Features
from sixway.models.features import GradientFeatures
from sixway.models.flow_lucas_kanade import LucasKanade
from sixway.models.flownet import load_flownet
from sixway.models.vgg import VGG16Features


def build_loss(config: LossConfig, *, steps: int | None = None) -> TotalLoss:
    """The loss with the networks that its weighted terms need, frozen, on the CPU.

    steps: length of the run, see `TotalLoss`. Raises ValueError or FileNotFoundError if weights are absent
    or other than meant, and names the remedy.
    """
    features = build_features(config) if config.perceptual > 0.0 else None
    estimator = build_estimator(config) if config.flow > 0.0 else None
    return TotalLoss(config, steps=steps, features=features, estimator=estimator)


def build_features(config: LossConfig) -> FeatureExtractor | None:
    """What the perceptual term sees with."""
    match config.features:
        case "gradients":
            return GradientFeatures()
        case "vgg16":
            return VGG16Features.load(None if config.vgg_weights is None else Path(config.vgg_weights))
        case "efficientnet_lite0":
            return EfficientNetLite0Features()
        case "none":
            return None


def build_estimator(config: LossConfig) -> FlowEstimator | None:
    """What the flow term, and a cache of true flows, see motion with."""
    match config.estimator:
        case "lucas_kanade":
            return LucasKanade()
        case "flownet":
            return load_flownet()
        case "none":
            return None
