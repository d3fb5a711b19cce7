"""Motion in the layers of a bake: the wind of the volumes, where the camera sees it."""

from pathlib import Path

import numpy as np
import pytest

from sixway.bake import main as bake
from sixway.core.exr import read_exr
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame
from sixway.engines.motion import FLOW_CHANNELS
from sixway.volumes.npz import write_npz

GRID = Grid.centred((12, 12, 12))


def volumes(folder: Path, *, wind: bool = True, frame_s: float = 0.1) -> str:
    """Two frames of a ball in an even wind of (0.4, 0.2, 0) m/s; the pattern of their files."""
    z, y, x = np.mgrid[:12, :12, :12].astype(np.float32)
    density = np.clip(4.0 - np.sqrt((x - 5.5) ** 2 + (y - 5.5) ** 2 + (z - 5.5) ** 2), 0.0, 1.0).astype(np.float32)
    velocity = np.broadcast_to(np.array([0.4, 0.2, 0.0], np.float32), (6, 6, 6, 3)).copy()
    for number in range(2):
        frame = DensityFrame(
            density=density, grid=GRID, time_s=frame_s * number, velocity_m_s=velocity if wind else None
        )
        write_npz(folder / f"frame_{number:04d}.npz", frame)
    return f"{folder}/frame_*.npz"


def test_layers_hold_the_wind_in_pixels_a_frame(tmp_path: Path) -> None:
    look = "--resolution 24 --samples 1 --projection orthographic --motion".split()
    assert bake([volumes(tmp_path / "npz"), "--out", f"{tmp_path}/maps", *look]) == 0
    image = read_exr(tmp_path / "maps/frame_0000.exr", ("alpha", *FLOW_CHANNELS))
    camera = Camera.around(GRID, kind="orthographic", width_px=24, height_px=24)
    px_per_m = 12.0 / camera.half_width_m
    np.testing.assert_allclose(image[12, 12, 1:], [0.04 * px_per_m, -0.02 * px_per_m], rtol=0.01)  # right, and up
    assert (image[image[..., 0] == 0.0][:, 1:] == 0.0).all()


@pytest.mark.parametrize(("about", "files"), [({"wind": False}, "*"), ({"frame_s": 0.0}, "*"), ({}, "0000")])
def test_volumes_that_do_not_tell_motion_are_refused(
    about: dict, files: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pattern = volumes(tmp_path / "npz", **about).replace("*", files)
    assert bake([pattern, "--out", f"{tmp_path}/maps", "--resolution", "8", "--motion"]) == 2
    assert "--motion" in capsys.readouterr().err
    assert not (tmp_path / "maps").exists()
