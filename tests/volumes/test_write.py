"""Every writer's file reads back as what it was, and damaged ones as an error that says so."""

import resource
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError
from sixway.volumes.read import READABLE, list_grids, read_volume
from sixway.volumes.write import WRITABLE, write_volume

DATA = Path(__file__).parent / "data"
PBRT = """MakeNamedMedium "smoke" "string type" "uniformgrid" # a comment with 9 [numbers]
  "integer nx" 2 "integer ny" [ 3 ] "integer nz" [1]
  "point3 p0" [ -1 0 2 ] "point3 p1" [ 0 1.5 2.5 ]
  "float density" [ 0 1 2
    3 4.5 5e-1 ]
"""


def smoke(shape: tuple[int, int, int], seed: int = 0) -> DensityFrame:
    rng = np.random.default_rng(seed)
    density = rng.random(shape, dtype=np.float32) * (rng.random(shape) < 0.3)
    grid = Grid(shape_zyx=shape, voxel_size_m=0.0123, origin_m=(-1.5, 2.25, 7.0))
    return DensityFrame(density=density.astype(np.float32), grid=grid)


@pytest.mark.parametrize("suffix", WRITABLE)
@pytest.mark.parametrize("shape", [(20, 33, 17), (1, 1, 1), (8, 16, 8), (3, 5, 300), (140, 9, 2)])
def test_a_written_frame_reads_back(tmp_path: Path, suffix: str, shape: tuple[int, int, int]) -> None:
    frame = smoke(shape)
    path = tmp_path / f"a{suffix}"
    write_volume(path, frame)
    back = read_volume(path)
    np.testing.assert_array_equal(back.density, frame.density)
    assert back.grid.voxel_size_m == pytest.approx(frame.grid.voxel_size_m, rel=1e-4 if suffix == ".vol" else 1e-12)
    np.testing.assert_allclose(back.grid.origin_m, frame.grid.origin_m, rtol=1e-6)
    z, y, x = shape
    (listed,) = list_grids(path)
    assert (listed.name, listed.grid_class, listed.box) == ("density", "fog volume", ((0, 0, 0), (x - 1, y - 1, z - 1)))
    assert list(tmp_path.iterdir()) == [path]


def test_equal_frames_give_equal_vdb_files(tmp_path: Path) -> None:
    for name in ("a.vdb", "b.vdb"):
        write_volume(tmp_path / name, smoke((9, 10, 11)))
    assert (tmp_path / "a.vdb").read_bytes() == (tmp_path / "b.vdb").read_bytes()


def test_vdb_spans_several_nodes_of_every_level(tmp_path: Path) -> None:
    """8192 voxels along x cross two root nodes; 130 along z two lower nodes."""
    density = np.zeros((130, 2, 8192), np.float32)
    density[::13, 1, ::97] = np.arange(10 * 85, dtype=np.float32).reshape(10, 85)
    frame = DensityFrame(density=density, grid=Grid.centred(density.shape))
    write_volume(tmp_path / "long.vdb", frame)
    np.testing.assert_array_equal(read_volume(tmp_path / "long.vdb").density, density)


def test_warp_reads_our_nanovdb(tmp_path: Path) -> None:
    frame = smoke((5, 6, 7))
    write_volume(tmp_path / "a.nvdb", frame)
    volume = wp.Volume.load_from_nvdb((tmp_path / "a.nvdb").read_bytes(), device="cpu")
    info = volume.get_grid_info()
    assert info.name == "density"
    np.testing.assert_allclose(info.translation, np.array(frame.grid.origin_m) + 0.5 * 0.0123, rtol=1e-6)


def test_a_nanovdb_of_several_segments_lists_them_all(tmp_path: Path) -> None:
    """Converters write one segment a grid."""
    for name, shape in (("a.nvdb", (5, 6, 7)), ("b.nvdb", (9, 9, 9))):
        write_volume(tmp_path / name, smoke(shape))
    other = (tmp_path / "b.nvdb").read_bytes().replace(b"density\0", b"heating\0")
    path = tmp_path / "both.nvdb"
    path.write_bytes((tmp_path / "a.nvdb").read_bytes() + other)
    assert [(grid.name, grid.box) for grid in list_grids(path)] == [
        ("density", ((0, 0, 0), (6, 5, 4))),
        ("heating", ((0, 0, 0), (8, 8, 8))),
    ]
    np.testing.assert_array_equal(read_volume(path, grid="heating").density, smoke((9, 9, 9)).density)
    with pytest.raises(VolumeError, match="holds no grid 'flame'"):
        read_volume(path, grid="flame")


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VolumeError, match=r"cannot write '\.obj'; known: \.vdb"):
        write_volume(tmp_path / "a.obj", smoke((2, 2, 2)))


def test_pbrt_text_reads_with_x_fastest(tmp_path: Path) -> None:
    (tmp_path / "a.pbrt").write_text(PBRT)
    frame = read_volume(tmp_path / "a.pbrt")
    np.testing.assert_array_equal(frame.density, np.float32([[[0, 1], [2, 3], [4.5, 0.5]]]))
    assert (frame.grid.voxel_size_m, frame.grid.origin_m) == (0.5, (-1.0, 0.0, 2.0))


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("5e-1", "", "holds 5 numbers, not 6"),
        ("4.5", "smoke", "more than numbers"),
        ("nx", "mx", "holds 6 numbers, not 3"),
        ("float density", "rgb density", "nanovdb medium"),
        ('nx" 2', 'nx" 2000000000', "refused"),
        ("2.5 ]", "9 ]", "not cubes"),
    ],
)
def test_bad_pbrt_is_refused(tmp_path: Path, old: str, new: str, reason: str) -> None:
    (tmp_path / "a.pbrt").write_text(PBRT.replace(old, new))
    with pytest.raises(VolumeError, match=reason):
        read_volume(tmp_path / "a.pbrt")


def test_a_plain_npy_reads(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.arange(24.0).reshape(2, 3, 4))
    frame = read_volume(tmp_path / "a.npy")
    assert frame.density.shape == (2, 3, 4)
    assert max(frame.grid.extent_m) == pytest.approx(1.0)
    np.save(tmp_path / "b.npy", np.ones((3, 3)))
    with pytest.raises(VolumeError, match="3D array"):
        read_volume(tmp_path / "b.npy")


def test_slight_undershoots_are_cut_and_real_ones_refused(tmp_path: Path) -> None:
    density = np.ones((2, 2, 2))
    density[0, 0, 0] = -0.005
    np.save(tmp_path / "a.npy", density)
    assert read_volume(tmp_path / "a.npy").density.min() == 0.0
    density[0, 0, 0] = -0.5
    np.save(tmp_path / "a.npy", density)
    with pytest.raises(VolumeError, match="1 NaN, infinite or negative"):
        read_volume(tmp_path / "a.npy")


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[bytes]]:
    """Undamaged files by suffix; a NanoVDB without zip too, whose checksum finds most damage."""
    folder = tmp_path_factory.mktemp("whole")
    files: dict[str, list[bytes]] = {".pbrt": [PBRT.encode()]}
    for suffix in WRITABLE:
        write_volume(folder / f"a{suffix}", smoke((9, 6, 7)))
        files[suffix] = [(folder / f"a{suffix}").read_bytes()]
    np.save(folder / "a.npy", smoke((9, 6, 7)).density)
    files[".npy"] = [(folder / "a.npy").read_bytes()]
    files[".vdb"] += [path.read_bytes() for path in sorted(DATA.glob("*.vdb"))]
    volume = wp.Volume.load_from_numpy(smoke((9, 6, 7)).density, device="cpu")
    volume.save_to_nvdb(str(folder / "plain.nvdb"))
    files[".nvdb"].append((folder / "plain.nvdb").read_bytes())
    return files


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    suffix=st.sampled_from(READABLE),
    which=st.integers(0, 3),
    cut=st.none() | st.floats(0.0, 1.0),
    wounds=st.lists(
        st.tuples(
            st.floats(0.0, 1.0), st.booleans(), st.sampled_from([0, 1, 0x7F, 0x80, 0xFF]), st.sampled_from([1, 4, 8])
        ),
        max_size=3,
    ),
)
def test_damaged_files_read_or_raise_a_clear_error(
    tmp_path: Path,
    whole_files: dict[str, list[bytes]],
    suffix: str,
    which: int,
    cut: float | None,
    wounds: list[tuple[float, bool, int, int]],
) -> None:
    """Cut short, or bytes overwritten anywhere or in the header: a frame or VolumeError, nothing else."""
    files = whole_files[suffix]
    data = bytearray(files[which % len(files)])
    for where, in_header, byte, width in wounds:
        at = int(where * (min(len(data), 900) - width if in_header else len(data) - width))
        data[at : at + width] = bytes([byte]) * width
    if cut is not None:
        del data[int(cut * len(data)) :]
    path = tmp_path / f"damaged{suffix}"
    path.write_bytes(bytes(data))
    try:
        frame = read_volume(path)
    except VolumeError as error:
        assert "damaged" in str(error)
    else:
        assert np.isfinite(frame.density).all()


@pytest.mark.parametrize("level", ["root", "upper", "lower"])
def test_forged_nanovdb_pointers_are_refused(tmp_path: Path, whole_files: dict[str, list[bytes]], level: str) -> None:
    """Offsets of children far outside the file."""
    data = bytearray(whole_files[".nvdb"][1])
    start = 16 + 176 + struct.unpack_from("<I", data, 16 + 136)[0]
    root = start + 672 + struct.unpack_from("<Q", data, start + 696)[0]
    upper = root + struct.unpack_from("<q", data, root + 64 + 8)[0]
    lower = upper + struct.unpack_from("<q", data, upper + 8256)[0]
    at = {"root": root + 64 + 8, "upper": upper + 8256, "lower": lower + 1088}[level]
    for forged in (1 << 40, -(1 << 40), (1 << 63) - 1, -(1 << 63)):
        struct.pack_into("<q", data, at, forged)
        (tmp_path / "forged.nvdb").write_bytes(bytes(data))
        with pytest.raises(VolumeError, match="damaged NanoVDB"):
            read_volume(tmp_path / "forged.nvdb")


@pytest.mark.skipif(sys.platform != "linux", reason="the limit of address space is Linux'")
def test_absurd_sizes_are_refused_before_memory_is_given(tmp_path: Path) -> None:
    """Each header promises a grid far larger than its file; the process may take 1 GiB more than it has."""
    with (tmp_path / "a.npy").open("wb") as file:
        header = {"descr": "<f4", "fortran_order": False, "shape": (1 << 14, 1 << 14, 1 << 14)}
        np.lib.format.write_array_header_1_0(file, header)
    (tmp_path / "a.vol").write_bytes(struct.pack("<3sB5i6f", b"VOL", 3, 1, 1 << 14, 1 << 14, 1 << 14, 1, *range(6)))
    (tmp_path / "a.pbrt").write_text(PBRT.replace('nx" 2', 'nx" 999999999'))
    write_volume(tmp_path / "a.vdb", smoke((9, 6, 7)))
    data = (tmp_path / "a.vdb").read_bytes()
    at = data.index(struct.pack("<ifII", 1, 0.0, 0, 1)) + 8
    (tmp_path / "a.vdb").write_bytes(
        data[:at] + struct.pack("<2I", 1, 1) + struct.pack("<3ifB", 1 << 30, 0, 0, 1.0, 1) + data[at + 8 :]
    )
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + (1 << 30), before[1]))
    try:
        for suffix in (".npy", ".vol", ".pbrt", ".vdb"):
            with pytest.raises(VolumeError, match="refused|truncated"):
                read_volume(tmp_path / f"a{suffix}")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
