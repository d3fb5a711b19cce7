"""Pictures of the sky from files."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from sixway.core.png import write_png
from sixway.shading.sky import read_environment


def test_png_and_exr_are_read_as_linear_light(tmp_path: Path, rng) -> None:
    sky = rng.random((4, 8, 3), dtype=np.float32)
    write_png(tmp_path / "sky.png", sky)
    np.testing.assert_allclose(read_environment(tmp_path / "sky.png"), sky, atol=0.005)
    planes = {name: np.ascontiguousarray(30.0 * sky[..., i]) for i, name in enumerate("RGB")}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(tmp_path / "sky.exr"))
    np.testing.assert_allclose(read_environment(tmp_path / "sky.exr"), 30.0 * sky, rtol=1e-6)


def test_what_is_no_sky_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such picture"):
        read_environment(tmp_path / "none.png")
    write_png(tmp_path / "square.png", np.ones((4, 4, 3), np.float32))
    with pytest.raises(ValueError, match="4 x 4 px; a lat-long picture is twice as wide"):
        read_environment(tmp_path / "square.png")
    for name in ("junk.png", "junk.exr"):
        (tmp_path / name).write_bytes(b"no picture")
        with pytest.raises(ValueError, match="not a"):
            read_environment(tmp_path / name)
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": np.ones((2, 4), np.float32)}) as file:
        file.write(str(tmp_path / "grey.exr"))
    with pytest.raises(ValueError, match="no channels R, G and B; it holds Y"):
        read_environment(tmp_path / "grey.exr")
