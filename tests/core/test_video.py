"""Videos: every picture in order, read back by ffmpeg, and nothing left of a failed one."""

from collections.abc import Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from sixway.core.video import write_video


def read(path: Path) -> tuple[dict[str, object], np.ndarray]:
    frames = imageio_ffmpeg.read_frames(str(path))
    about = next(frames)
    width, height = about["size"]
    return about, np.stack([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in frames])


def ramp(count: int, height: int, width: int) -> np.ndarray:
    """Grey that rises from picture to picture; the right half 60 brighter."""
    pictures = np.zeros((count, height, width, 3), np.uint8)
    pictures[:] = (20 + 20 * np.arange(count, dtype=np.uint8))[:, None, None, None]
    pictures[:, :, width // 2 :] += 60
    return pictures


def test_every_picture_arrives_in_order(tmp_path: Path) -> None:
    pictures = ramp(7, 32, 48)
    write_video(tmp_path / "a.mp4", iter(pictures), width=48, height=32, fps=12)
    about, seen = read(tmp_path / "a.mp4")
    assert about["codec"] == "h264"
    assert about["fps"] == 12
    assert seen.shape == pictures.shape
    np.testing.assert_allclose(seen.mean(axis=(1, 2, 3)), pictures.mean(axis=(1, 2, 3)), atol=4.0)
    np.testing.assert_allclose(seen[:, :, 40].mean() - seen[:, :, 8].mean(), 60.0, atol=6.0)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_odd_sides_lose_a_row_or_column(tmp_path: Path) -> None:
    write_video(tmp_path / "b.mp4", ramp(3, 21, 33), width=33, height=21, fps=24)
    _, seen = read(tmp_path / "b.mp4")
    assert seen.shape == (3, 20, 32, 3)
    assert seen[0, :, 24:].mean() > seen[0, :, :8].mean() + 40.0  # rows did not slip


def test_a_failure_between_pictures_leaves_the_old_video(tmp_path: Path) -> None:
    path = tmp_path / "c.mp4"
    path.write_bytes(b"older")

    def pictures() -> Iterator[np.ndarray]:
        yield from ramp(2, 16, 16)
        raise RuntimeError("killed")

    with pytest.raises(RuntimeError, match="killed"):
        write_video(path, pictures(), width=16, height=16, fps=24)
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("count", "side"), [(3, 1), (0, 16)], ids=["too small for H.264", "no pictures"])
def test_a_video_that_ffmpeg_cannot_write_is_an_error(tmp_path: Path, count: int, side: int) -> None:
    with pytest.raises((OSError, ValueError, RuntimeError), match="d.mp4"):
        write_video(tmp_path / "d.mp4", ramp(count, side, side), width=side, height=side, fps=24)
    assert not list(tmp_path.iterdir())
