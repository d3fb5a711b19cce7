"""Pictures to an H.264 file, by the ffmpeg that `imageio-ffmpeg` ships."""

from collections.abc import Iterable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from jaxtyping import UInt8

from sixway.core.store import atomic_path


def write_video(
    path: Path, pictures: Iterable[UInt8[np.ndarray, "h w 3"]], *, width: int, height: int, fps: int
) -> None:
    """Write pictures of one size as .mp4, whole or not at all; odd sides lose their last row or column."""
    even = (width - width % 2, height - height % 2)
    with atomic_path(path) as temporary:
        writer = imageio_ffmpeg.write_frames(
            str(temporary), even, fps=fps, macro_block_size=1, quality=8, ffmpeg_log_level="error"
        )
        writer.send(None)
        try:
            for picture in pictures:
                writer.send(np.ascontiguousarray(picture[: even[1], : even[0]]))
        finally:
            writer.close()
