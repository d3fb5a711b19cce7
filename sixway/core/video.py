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
    """Write pictures of one size as .mp4, whole or not at all; odd sides lose their last row or column.

    Raises ValueError naming the file if there are no pictures or H.264 cannot hold their size.
    """
    even = (width - width % 2, height - height % 2)
    with atomic_path(path) as temporary:
        writer = imageio_ffmpeg.write_frames(
            str(temporary), even, fps=fps, macro_block_size=1, quality=8, ffmpeg_log_level="error"
        )
        writer.send(None)
        count = 0
        try:
            for picture in pictures:
                writer.send(np.ascontiguousarray(picture[: even[1], : even[0]]))
                count += 1
        finally:
            writer.close()
        if _num_frames(temporary) != count or count == 0:  # the writer does not tell what ffmpeg thought of them
            raise ValueError(f"{path}: ffmpeg cannot write {count} pictures of {width} x {height} as H.264")


def _num_frames(path: Path) -> int:
    try:
        return int(imageio_ffmpeg.count_frames_and_secs(str(path))[0])
    except RuntimeError:
        return 0
