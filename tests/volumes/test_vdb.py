"""OpenVDB files: those that OpenVDB wrote (data/make_fixtures.cc), Blender's fire, and what must be refused."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from sixway.volumes.limits import VolumeError
from sixway.volumes.read import list_grids, read_volume

DATA = Path(__file__).parent / "data"
VOXEL = 0.125
CENTRE_OF_0 = np.array([1.5, -2.25, 0.5])


def value(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The closed form of make_fixtures.cc."""
    return (((x * 7 + y * 13 + z * 29) & 63) + 1) / 64.0


def indices(first: tuple[int, int, int], last: tuple[int, int, int]) -> tuple[np.ndarray, ...]:
    """x, y, z of every voxel of a box, in arrays [z, y, x]."""
    z, y, x = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(first[::-1], last[::-1], strict=True)), indexing="ij")
    return x, y, z


def place(first: tuple[int, int, int]) -> np.ndarray:
    return CENTRE_OF_0 + (np.array(first) - 0.5) * VOXEL


def test_tiles_half_floats_and_zip_are_what_openvdb_wrote() -> None:
    frame = read_volume(DATA / "tiles_half_zip.vdb")
    first, last = (-128, -9, 0), (31, 127, 127)
    x, y, z = indices(first, last)
    truth = np.zeros(x.shape, np.float32)
    truth[(x < 0) & (y >= 0)] = 0.5
    truth[(x >= 0) & (x < 32) & (y >= 0) & (y < 16) & (z < 8)] = 1.25
    truth[(x >= 0) & (x < 8) & (y >= 32) & (y < 40) & (z < 8)] = 0.75
    voxels = (x >= -20) & (x < 20) & (y < -2) & (z >= 3) & (z < 20)
    truth[voxels] = value(x, y, z)[voxels]
    np.testing.assert_array_equal(frame.density, truth)
    np.testing.assert_allclose(frame.grid.origin_m, place(first))
    assert frame.grid.voxel_size_m == VOXEL


def test_inactive_values_doubles_and_blosc_are_what_openvdb_wrote() -> None:
    pytest.importorskip("numcodecs")
    frame = read_volume(DATA / "inactive_double_blosc.vdb")
    x, y, z = indices((64, 0, -8), (95, 7, -1))
    n, leaf = (x + y + z) & 3, (x - 64) // 8
    inactive = np.select([leaf == 0, leaf == 1, leaf == 2], [0.3125, 0.25 * (n & 2), 1.0 + (n & 2)], 0.125 * y)
    truth = np.where(n == 0, value(x, y, z) / 3.0, inactive).astype(np.float32)
    np.testing.assert_array_equal(frame.density, truth)


def test_blosc_without_its_decoder_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numcodecs.blosc", None)
    assert [grid.name for grid in list_grids(DATA / "inactive_double_blosc.vdb")] == ["density"]
    with pytest.raises(VolumeError, match=r"pip install numcodecs"):
        read_volume(DATA / "inactive_double_blosc.vdb")


def test_list_grids_tells_names_kinds_and_boxes() -> None:
    box = ((2, 4, 9), (11, 22, 18))
    grids = {grid.name: grid for grid in list_grids(DATA / "several_none.vdb")}
    assert list(grids) == ["", "flame", "shared", "surface", "vel", "turned", "frustum"]
    assert grids[""].box == grids["shared"].box == box
    assert (grids["flame"].box, grids["flame"].is_smoke) == (None, True)
    assert (grids["surface"].grid_class, grids["surface"].is_smoke) == ("level set", False)
    assert (grids["vel"].kind, grids["vel"].is_smoke) == ("vec3s", False)


def test_an_unnamed_and_a_shared_grid_read_with_their_own_transforms() -> None:
    unnamed = read_volume(DATA / "several_none.vdb", grid="")
    shared = read_volume(DATA / "several_none.vdb", grid="shared")
    x, y, z = indices((2, 4, 9), (11, 22, 18))
    truth = np.where((y == 2 * x) & (z == 20 - x), value(x, y, z), 0.0).astype(np.float32)
    np.testing.assert_array_equal(unnamed.density, truth)
    np.testing.assert_array_equal(shared.density, truth)
    np.testing.assert_allclose(unnamed.grid.origin_m, place((2, 4, 9)))
    assert (shared.grid.voxel_size_m, shared.grid.origin_m) == (2.0, (3.0, 7.0, 17.0))


def test_an_empty_grid_is_a_small_box_of_zeros() -> None:
    frame = read_volume(DATA / "several_none.vdb", grid="flame")
    assert frame.density.shape == (8, 8, 8)
    assert not frame.density.any()
    np.testing.assert_allclose(frame.grid.origin_m, place((0, 0, 0)))


@pytest.mark.parametrize(
    ("grid", "reason"),
    [
        (None, r"holds no grid 'density' \(it holds: '' \(float, fog volume\), 'flame'"),
        ("density", "holds no grid 'density'"),
        ("smoke", "holds no grid 'smoke'"),
        ("surface", "level set, not fog; convert it to a fog volume"),
        ("vel", "holds vec3s values, not density"),
        ("turned", "rotated or sheared"),
        ("frustum", "NonlinearFrustumMap.*resample"),
    ],
)
def test_what_is_no_density_is_refused_with_a_remedy(grid: str | None, reason: str) -> None:
    with pytest.raises(VolumeError, match=reason):
        read_volume(DATA / "several_none.vdb", grid=grid)


def altered(tmp_path: Path, at: int, layout: str, new: int) -> Path:
    data = bytearray((DATA / "several_none.vdb").read_bytes())
    struct.pack_into(layout, data, at, new)
    path = tmp_path / "altered.vdb"
    path.write_bytes(bytes(data))
    return path


def test_other_versions_streams_and_points_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VolumeError, match="version 221"):
        read_volume(altered(tmp_path, 8, "<I", 221))
    with pytest.raises(VolumeError, match="streamed"):
        read_volume(altered(tmp_path, 20, "<B", 0))
    with pytest.raises(VolumeError, match="not an OpenVDB file"):
        read_volume(altered(tmp_path, 0, "<B", 7))
    points = (DATA / "inactive_double_blosc.vdb").read_bytes().replace(b"Tree_double_5_4_3", b"Tree_ptdata_5_4_3")
    (tmp_path / "points.vdb").write_bytes(points)
    with pytest.raises(VolumeError, match="points, not density"):
        read_volume(tmp_path / "points.vdb")


def test_grids_that_point_backwards_end(tmp_path: Path) -> None:
    """A descriptor whose end lies before its start would be read for ever."""
    data = (DATA / "several_none.vdb").read_bytes()
    first = data.index(b"Tree_float") + len("Tree_float_5_4_3") + 4
    with pytest.raises(VolumeError, match="damaged grid offsets"):
        list_grids(altered(tmp_path, first + 16, "<q", 60))


def test_blenders_fire_reads(real_volumes: Path) -> None:
    """Half floats, zip, staggered velocity beside, z up, an empty flame in later frames."""
    folder = real_volumes / "mantaflow_fire"
    frame = read_volume(folder / "fluid_data_0024.vdb", up="z")
    assert frame.grid.shape_zyx == (42, 55, 41)  # z, y (up), x
    assert frame.grid.voxel_size_m == pytest.approx(0.0625)
    assert 0.9 < frame.density.max() < 1.0
    assert read_volume(folder / "fluid_data_0008.vdb", up="z").grid.extent_m[1] < frame.grid.extent_m[1]  # it rises
    for number in (32, 40):
        assert not read_volume(folder / f"fluid_data_00{number}.vdb", grid="flame").density.any()
    with pytest.raises(VolumeError, match="vec3s"):
        read_volume(folder / "fluid_data_0024.vdb", grid="velocity")
    with pytest.raises(VolumeError, match="negative"):
        read_volume(folder / "fluid_data_0024.vdb", grid="shadow")  # constant tiles of -1
