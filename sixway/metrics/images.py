"""What every metric asks of its images, checked once at the door."""

import numpy as np


def check_pair(predicted: np.ndarray, reference: np.ndarray) -> None:
    """Raise ValueError unless both are finite images [h, w, c] of one shape with at least one pixel."""
    for name, image in (("predicted", predicted), ("reference", reference)):
        if image.ndim != 3 or image.size == 0:
            raise ValueError(f"{name} image has shape {image.shape}; a metric needs [h, w, c] with at least one pixel")
        bad = int(np.count_nonzero(~np.isfinite(image)))
        if bad:
            raise ValueError(f"{name} image holds {bad} NaN or infinite values; a score would hide them")
    if predicted.shape != reference.shape:
        raise ValueError(f"predicted {predicted.shape} and reference {reference.shape} must have one shape")


def check_mask(mask: np.ndarray, image: np.ndarray) -> None:
    """Raise ValueError unless the mask has one boolean a pixel."""
    if mask.dtype != np.bool_ or mask.shape != image.shape[:2]:
        raise ValueError(
            f"mask of {mask.dtype} {mask.shape} must be boolean {image.shape[:2]}; compare alpha with a threshold"
        )
