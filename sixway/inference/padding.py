"""Guides of any size for nets that want multiples of their stride."""

import numpy as np
from jaxtyping import Float


def pad_guide(
    guide: Float[np.ndarray, "n g h w"], channels: tuple[str, ...], stride: int
) -> Float[np.ndarray, "n g padded_h padded_w"]:
    """Empty space to the right and below, to multiples of `stride` px: no light, all transmitted."""
    below, right = -guide.shape[2] % stride, -guide.shape[3] % stride
    if not below and not right:
        return guide
    padded = np.pad(guide, ((0, 0), (0, 0), (0, below), (0, right)))
    transmittance = padded[:, channels.index("transmittance")]
    transmittance[:, guide.shape[2] :] = 1.0
    transmittance[:, :, guide.shape[3] :] = 1.0
    return padded
