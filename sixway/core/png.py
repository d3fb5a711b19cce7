"""Pictures for people: linear radiance to 8-bit sRGB PNG, and back for comparisons."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from sixway.core.color import encode_srgb
from sixway.core.store import atomic_path


def to_8bit(encoded: Float[np.ndarray, "h w c"]) -> UInt8[np.ndarray, "h w c"]:
    """Values in [0, 1], already encoded for display, to bytes; what lies outside is clipped."""
    return (np.clip(encoded, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def write_png(path: Path, linear: Float[np.ndarray, "h w c"]) -> None:
    """Write linear RGB (c = 3) or grey (c = 1) as an sRGB PNG, atomically."""
    write_8bit_png(path, to_8bit(encode_srgb(linear)))


def write_8bit_png(path: Path, pixels: UInt8[np.ndarray, "h w c"]) -> None:
    """Write bytes as they are: grey (c = 1), RGB (3) or RGBA (4)."""
    with atomic_path(path) as temporary:
        Image.fromarray(pixels[..., 0] if pixels.shape[-1] == 1 else pixels).save(temporary, format="PNG")
