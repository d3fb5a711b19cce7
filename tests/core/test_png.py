"""PNGs: the sRGB curve, rounding, clipping, and one file that is whole."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixway.core.png import to_8bit, write_8bit_png, write_png


def read(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image)


def test_bytes_are_rounded_and_clipped() -> None:
    values = np.array([[[-0.5], [0.0], [0.4 / 255], [0.6 / 255], [254.4 / 255], [1.0], [7.0]]], np.float32)
    np.testing.assert_array_equal(to_8bit(values)[0, :, 0], [0, 0, 0, 1, 254, 255, 255])


def test_every_byte_survives() -> None:
    bytes_ = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
    np.testing.assert_array_equal(to_8bit(bytes_.astype(np.float32) / 255.0), bytes_)


def test_linear_colour_is_encoded_upright(tmp_path: Path) -> None:
    """Known points of IEC 61966-2-1: 0.21586 is 128, 0.5 is 188; row 0 is on top."""
    linear = np.zeros((2, 3, 3), np.float32)
    linear[0, 0] = (0.21586, 0.5, 1.0)
    linear[1, 2] = (5.0, 0.001, 0.0)
    write_png(tmp_path / "a.png", linear)
    pixels = read(tmp_path / "a.png")
    assert pixels.shape == (2, 3, 3)
    np.testing.assert_array_equal(pixels[0, 0], (128, 188, 255))
    np.testing.assert_array_equal(pixels[1, 2], (255, 3, 0))
    assert pixels[0, 1:].max() == 0


@pytest.mark.parametrize(("channels", "mode"), [(1, "L"), (3, "RGB"), (4, "RGBA")])
def test_channels_choose_the_kind_of_png(tmp_path: Path, rng: np.random.Generator, channels: int, mode: str) -> None:
    pixels = rng.integers(0, 256, (5, 7, channels), dtype=np.uint8)
    write_8bit_png(tmp_path / "b.png", pixels)
    with Image.open(tmp_path / "b.png") as image:
        assert (image.mode, image.size) == (mode, (7, 5))
    np.testing.assert_array_equal(read(tmp_path / "b.png").reshape(pixels.shape), pixels)


def test_a_failed_write_keeps_the_picture_before_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "c.png"
    write_png(path, np.ones((2, 2, 3), np.float32))

    def torn(self: Image.Image, file: Path, **options: object) -> None:
        Path(file).write_bytes(b"half a picture")
        raise OSError("torn")

    monkeypatch.setattr(Image.Image, "save", torn)
    with pytest.raises(OSError, match="torn"):
        write_png(path, np.zeros((2, 2, 3), np.float32))
    assert read(path).min() == 255
    assert list(tmp_path.iterdir()) == [path]
