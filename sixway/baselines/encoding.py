"""Guides and true maps of a dataset in the numbers that a net reads and answers."""

import numpy as np
from jaxtyping import Float

from sixway.data.clips import Batch
from sixway.data.dataset import SmokeDataset
from sixway.models.conditioning import GuideConditioning
from sixway.models.encoding import encode_lightmap

Guide = Float[np.ndarray, "n g h w"]
"""Raw guide channels."""

Encoded = Float[np.ndarray, "n 8 h w"]
"""sRGB-encoded scaled light and linear alpha, in the order of `LIGHTMAP_CHANNELS`."""


def encode_target(dataset: SmokeDataset, pair: Batch) -> Encoded:
    """The true maps of a pair in the net's encoding."""
    return encode_lightmap(pair.target, scale=dataset.scale, emissive_scale=dataset.emissive_scale).numpy()


def conditioning(dataset: SmokeDataset) -> GuideConditioning:
    """How a net of this dataset would see its guide."""
    return GuideConditioning(dataset.guide_channels, scale=dataset.scale, emissive_scale=dataset.emissive_scale)
