"""OpenEXR frames: one part, layers by name, half floats, and a reader that notices every corruption.

Each channel is its own layer (``right.V``, ``alpha.V``, ...), which is how Blender and Nuke name layers
of one value. OpenEXR's Python reader drops a part whose pixels are corrupt with no exception, so what is
read is compared with what the header promised.
"""

import errno
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
from jaxtyping import Float

from sixway.core.store import atomic_path

LARGEST_SIDE_PX = 8192
_LARGEST_FILE_BYTES = 2 << 30


class CorruptFrameError(ValueError):
    """A frame on disk that cannot be trusted; the message names the file and the remedy."""


def write_exr(
    path: Path,
    image: Float[np.ndarray, "h w c"],
    channels: tuple[str, ...],
    attributes: Mapping[str, str | int | float] | None = None,
) -> None:
    """Write `image` atomically with its channels by name, ZIP-compressed half floats.

    Half keeps 11 bits: a relative error of at most 4.9e-4. Raises ValueError for values that half
    cannot hold (NaN, or beyond 65504) and for a channel count that differs from the names.
    """
    if image.ndim != 3 or image.shape[-1] != len(channels):
        raise ValueError(f"{path}: image {image.shape} does not hold the channels {channels}")
    if not np.all(np.abs(image) <= 65504.0):
        raise ValueError(f"{path}: values must be finite and at most 65504 to be stored as half floats")
    half = image.astype(np.float16)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **(attributes or {})}
    planes = {f"{name}.V": np.ascontiguousarray(half[..., i]) for i, name in enumerate(channels)}
    with atomic_path(path) as temporary, OpenEXR.File(header, planes) as file:
        try:
            file.write(str(temporary))
        except RuntimeError as error:  # OpenEXR tells a full disk in words only
            if os.strerror(errno.ENOSPC) in str(error):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from error
            raise


def read_exr(
    path: Path, channels: tuple[str, ...], shape_px: tuple[int, int] | None = None
) -> Float[np.ndarray, "h w c"]:
    """Read the named channels as float32 [h, w, c], in the order asked for.

    Raises FileNotFoundError if the file is missing, and CorruptFrameError if it is truncated, is no
    EXR, misses a channel, has another size than `shape_px` (height, width), or holds NaN.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: this frame is missing; run the generation command again to remake it")
    remedy = "delete the file and run the generation command again"
    if path.stat().st_size > _LARGEST_FILE_BYTES:
        raise CorruptFrameError(f"{path}: larger than {_LARGEST_FILE_BYTES} bytes; {remedy}")
    # A forged header may ask for any amount of memory: bound it before pixels are touched.
    OpenEXR.setMaxImageSize(LARGEST_SIDE_PX, LARGEST_SIDE_PX)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            parts = file.parts
            planes = {name: plane.pixels for name, plane in file.channels().items()} if parts else {}
    except Exception as error:  # OpenEXR raises bare RuntimeError and others on junk
        raise CorruptFrameError(f"{path}: not a readable EXR file ({error}); {remedy}") from error
    missing = [name for name in channels if f"{name}.V" not in planes]
    if missing:
        held = ", ".join(sorted(planes)) or "none that can be decoded: the file is truncated"
        raise CorruptFrameError(f"{path}: channels {missing} are missing (it holds {held}); {remedy}")
    image = np.stack([planes[f"{name}.V"].astype(np.float32) for name in channels], axis=-1)
    if shape_px is not None and image.shape[:2] != shape_px:
        raise CorruptFrameError(f"{path}: image is {image.shape[:2]} (h, w), expected {shape_px}; {remedy}")
    if not np.isfinite(image).all():
        raise CorruptFrameError(f"{path}: holds NaN or infinite values; {remedy}")
    return image


def read_exr_attributes(path: Path) -> dict[str, object]:
    """The header of the first part: our own attributes beside OpenEXR's."""
    with OpenEXR.File(str(path), header_only=True) as file:
        return dict(file.parts[0].header)
