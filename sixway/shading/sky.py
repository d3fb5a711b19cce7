"""Pictures of the sky from files: lat-long, linear."""

from pathlib import Path

import numpy as np
import OpenEXR
from jaxtyping import Float
from PIL import Image, UnidentifiedImageError

from sixway.core.color import decode_srgb


def read_environment(path: Path) -> Float[np.ndarray, "h w 3"]:
    """A lat-long picture as linear RGB, float32: .exr as it is, 8-bit files (.png, .jpg) from sRGB.

    Raises FileNotFoundError, and ValueError for what is no picture, is not twice as wide as high, or holds NaN.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such picture of the sky")
    image = _read_exr(path) if path.suffix.lower() == ".exr" else _read_8bit(path)
    height, width, _ = image.shape
    if abs(width - 2 * height) > 1:
        raise ValueError(f"{path}: {width} x {height} px; a lat-long picture is twice as wide as high")
    if not (np.isfinite(image).all() and image.min() >= 0.0):
        raise ValueError(f"{path}: holds NaN, infinite or negative values; repair the picture")
    return image


def _read_exr(path: Path) -> Float[np.ndarray, "h w 3"]:
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            planes = {name: channel.pixels for name, channel in file.channels().items()}
    except Exception as error:  # OpenEXR raises bare RuntimeError and others on junk
        raise ValueError(f"{path}: not a readable EXR file ({error})") from error
    if not {"R", "G", "B"} <= planes.keys():
        raise ValueError(f"{path}: has no channels R, G and B; it holds {', '.join(sorted(planes))}")
    return np.stack([planes[name] for name in "RGB"], axis=-1).astype(np.float32)


def _read_8bit(path: Path) -> Float[np.ndarray, "h w 3"]:
    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB"))
    except UnidentifiedImageError as error:
        raise ValueError(f"{path}: not a picture that can be read; give .exr, .png or .jpg") from error
    return decode_srgb(pixels.astype(np.float32) / 255.0)
