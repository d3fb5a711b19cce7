"""Volumes in: real files of other people, our own round trip, and files that lie."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.extinction import extinction_for_optical_depth
from sixway.volumes.limits import VolumeError, cubic_voxel
from sixway.volumes.npz import read_npz, write_npz
from sixway.volumes.read import find_volumes, read_volume, z_up_to_y_up


def frame_of(density: np.ndarray, **more: object) -> DensityFrame:
    return DensityFrame(density=density, grid=Grid.centred(density.shape), **more)  # type: ignore[arg-type]


def test_npz_round_trip_is_exact(tmp_path: Path, rng) -> None:
    frame = frame_of(
        rng.random((4, 5, 6), dtype=np.float32),
        time_s=1.25,
        velocity_m_s=rng.random((2, 2, 3, 3), dtype=np.float32),
        obstacle=rng.random((4, 5, 6), dtype=np.float32),
        emission=rng.random((4, 5, 6), dtype=np.float32),
    )
    write_npz(tmp_path / "a.npz", frame)
    back = read_volume(tmp_path / "a.npz")
    assert back.grid == frame.grid
    assert back.time_s == 1.25
    for name in ("density", "velocity_m_s", "obstacle", "emission"):
        np.testing.assert_array_equal(getattr(back, name), getattr(frame, name))


def test_a_plain_npz_of_a_numpy_user_reads(tmp_path: Path) -> None:
    np.savez(tmp_path / "b.npz", density=np.ones((3, 4, 5)))
    frame = read_volume(tmp_path / "b.npz")
    assert frame.density.dtype == np.float32
    assert max(frame.grid.extent_m) == pytest.approx(1.0)


@pytest.mark.parametrize("bad", [np.nan, -1.0, np.inf])
def test_bad_density_is_refused_by_file_name(tmp_path: Path, bad: float) -> None:
    density = np.zeros((3, 3, 3), np.float32)
    density[1, 1, 1] = bad
    np.savez(tmp_path / "c.npz", density=density)
    with pytest.raises(VolumeError, match=r"c\.npz.*density holds 1"):
        read_volume(tmp_path / "c.npz")


def test_pickles_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "d.npz", density=np.array([object()], dtype=object))
    with pytest.raises(VolumeError, match="plain arrays"):
        read_volume(tmp_path / "d.npz")


def test_unknown_and_missing_files_say_so(tmp_path: Path) -> None:
    (tmp_path / "a.vdbx").write_text("x")
    with pytest.raises(VolumeError, match=r"known: \.vdb \.nvdb \.vol \.npz"):
        read_volume(tmp_path / "a.vdbx")
    with pytest.raises(FileNotFoundError, match="no such volume"):
        read_volume(tmp_path / "none.npz")
    with pytest.raises(FileNotFoundError, match="no volume matches"):
        find_volumes(str(tmp_path / "*.npz"))


def test_a_folder_of_a_simulation_holds_each_frame_once_and_no_checkpoint(tmp_path: Path) -> None:
    for name in ("frame_0000.npz", "frame_0000.vdb", "frame_0001.nvdb", "frame_0001.npz", "checkpoint.npz"):
        (tmp_path / name).touch()
    (tmp_path / "frame_0002.vdb").touch()
    (tmp_path / "frame_0002.npz").mkdir()
    expected = ["frame_0000.npz", "frame_0001.npz", "frame_0002.vdb"]
    assert [path.name for path in find_volumes(str(tmp_path))] == expected
    assert [path.name for path in find_volumes(str(tmp_path / "*.npz"))] == expected[:2]
    assert [path.name for path in find_volumes(str(tmp_path / "*.vdb"))] == ["frame_0000.vdb", "frame_0002.vdb"]
    assert find_volumes(str(tmp_path / "checkpoint.npz")) == [tmp_path / "checkpoint.npz"]  # who names it means it


def nvdb_bytes(density: np.ndarray, tmp: Path) -> bytes:
    volume = wp.Volume.load_from_numpy(density, min_world=(1.0, 2.0, 3.0), voxel_size=0.5, device="cpu")
    volume.save_to_nvdb(str(tmp), codec="zip")
    return tmp.read_bytes()


@pytest.fixture(scope="module")
def good_nvdb(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    density = np.random.default_rng(0).random((9, 6, 7)).astype(np.float32)
    return nvdb_bytes(density, tmp_path_factory.mktemp("nvdb") / "good.nvdb")


def test_nanovdb_keeps_place_values_and_order(tmp_path: Path) -> None:
    density = np.zeros((9, 6, 7), np.float32)  # Warp's order is x, y, z
    density[8, 0, 0], density[0, 5, 0], density[0, 0, 6] = 1.0, 2.0, 3.0
    path = tmp_path / "a.nvdb"
    path.write_bytes(nvdb_bytes(density, path))
    frame = read_volume(path)
    ones = np.argwhere(frame.density == 1.0)[0]
    threes = np.argwhere(frame.density == 3.0)[0]
    corner = np.argwhere(frame.density == 2.0)[0]
    assert tuple(ones - corner) == (0, -5, 8)  # z, y, x
    assert tuple(threes - corner) == (6, -5, 0)
    assert frame.grid.voxel_size_m == pytest.approx(0.5)


def test_a_decompression_bomb_is_stopped(tmp_path: Path, good_nvdb: bytes) -> None:
    head = bytearray(good_nvdb[: 16 + 176 + struct.unpack_from("<I", good_nvdb, 16 + 136)[0]])
    bomb = zlib.compress(bytes(64 << 20))
    stored = struct.pack("<Q", len(bomb)) + bomb
    struct.pack_into("<Q", head, 16, 4096)
    path = tmp_path / "bomb.nvdb"
    path.write_bytes(bytes(head) + stored)
    with pytest.raises(VolumeError, match="not of the size that its header tells"):
        read_volume(path)


def test_turning_z_up_mirrors_nothing(rng) -> None:
    density = np.zeros((4, 5, 6), np.float32)
    density[3, 1, 2] = 1.0  # z = 3 (top), y = 1, x = 2
    wind = np.zeros((4, 5, 6, 3), np.float32)
    wind[...] = (0.0, 0.0, 1.0)
    frame = frame_of(density, velocity_m_s=wind)
    turned = z_up_to_y_up(frame)
    assert tuple(np.argwhere(turned.density == 1.0)[0]) == (5 - 1 - 1, 3, 2)
    np.testing.assert_array_equal(turned.velocity_m_s[0, 0, 0], (0.0, 1.0, 0.0))
    size = frame.grid.voxel_size_m
    old = np.array(frame.grid.origin_m) + size * np.array([2.5, 1.5, 3.5])
    new = np.array(turned.grid.origin_m) + size * np.array([2.5, 3.5, 3.5])
    np.testing.assert_allclose(new, [old[0], old[2], -old[1]])


def test_extinction_gives_the_optical_depth_asked_for() -> None:
    density = np.zeros((8, 8, 8), np.float32)
    density[2:6, 2:6, 2:6] = 25.0
    frame = frame_of(density)
    extinction = extinction_for_optical_depth(frame, optical_depth=8.0)
    assert extinction * 25.0 * 4 * frame.grid.voxel_size_m == pytest.approx(8.0)
    with pytest.raises(VolumeError, match="no smoke"):
        extinction_for_optical_depth(frame_of(np.zeros((2, 2, 2), np.float32)))


def test_real_volumes(real_volumes: Path) -> None:
    cloud = read_volume(real_volumes / "shadeops_teapot_cloud.nvdb")
    assert cloud.grid.voxel_size_m == pytest.approx(0.0076715, rel=1e-3)
    assert cloud.density.max() == pytest.approx(50.0, rel=0.01)
    assert cloud.grid.origin_m[0] == pytest.approx(-136.5 * 0.0076715, abs=1e-3)
    steam = read_volume(real_volumes / "mitsuba_tutorial_volume.vol", up="z")
    assert steam.grid.shape_zyx == (45, 53, 44)
    assert steam.density.max() == pytest.approx(1.85, abs=0.01)
    assert extinction_for_optical_depth(steam) > 0.0


def test_npz_bomb_is_refused_before_memory_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sixway.volumes.npz.LARGEST_FILE_BYTES", 1000)
    np.savez_compressed(tmp_path / "z.npz", density=np.zeros((32, 32, 32), np.float32))
    with pytest.raises(VolumeError, match="unpacks to"):
        read_npz(tmp_path / "z.npz")


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0, -0.5])
def test_a_voxel_edge_that_is_no_length_is_refused(place: int, bad: float) -> None:
    edges = [0.5, 0.5, 0.5]
    edges[place] = bad
    with pytest.raises(VolumeError, match="are not cubes"):
        cubic_voxel("a.nvdb", (edges[0], edges[1], edges[2]))
