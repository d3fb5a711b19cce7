"""Files: whole or absent, and honest about what they hold."""

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.exr import CorruptFrameError, read_exr, read_exr_attributes, write_exr
from sixway.core.records import DensityFrame, Grid, GuideMap, SixWayLightmap
from sixway.core.store import (
    append_json_line,
    atomic_path,
    claim_folder,
    content_hash,
    inside,
    read_json,
    read_json_lines,
    write_json,
    write_with_holes,
)

CHANNELS = ("right", "left", "alpha")


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"old": 1})
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError("killed")
    assert read_json(path) == {"old": 1}
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="disk is full.*run the same command again"), atomic_path(tmp_path / "b"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_a_log_survives_half_a_line(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    append_json_line(path, {"n": 1})
    with path.open("a") as file:
        file.write('{"n": 2, "torn')
    append_json_line(path, {"n": 3})
    assert [line["n"] for line in read_json_lines(path)] == [1, 3]


def test_hashes_ignore_key_order_and_see_every_value() -> None:
    assert content_hash({"a": 1, "b": [1.5]}) == content_hash({"b": [1.5], "a": 1})
    assert content_hash({"a": 1}) != content_hash({"a": 2})


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../x"])
def test_no_path_leaves_its_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="points outside"):
        inside(tmp_path, name)
    assert inside(tmp_path, "a/b.exr").is_relative_to(tmp_path.resolve())


def test_exr_keeps_names_and_values_to_half_precision(tmp_path: Path, rng) -> None:
    path = tmp_path / "a.exr"
    image = rng.random((31, 45, 3), dtype=np.float32)
    write_exr(path, image, CHANNELS, {"seed": 7})
    np.testing.assert_allclose(read_exr(path, CHANNELS, (31, 45)), image, rtol=4.9e-4, atol=1e-7)
    swapped = read_exr(path, ("alpha", "right"))
    np.testing.assert_allclose(swapped[..., 0], image[..., 2], rtol=4.9e-4, atol=1e-7)
    assert read_exr_attributes(path)["seed"] == 7


@pytest.fixture(scope="module")
def exr_bytes(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("exr") / "a.exr"
    write_exr(path, np.random.default_rng(1).random((40, 33, 3), dtype=np.float32), CHANNELS)
    return path.read_bytes()


@pytest.mark.parametrize("part", [0.0, 0.05, 0.3, 0.6, 0.95])
def test_a_truncated_exr_is_named_corrupt(tmp_path: Path, exr_bytes: bytes, part: float) -> None:
    path = tmp_path / "cut.exr"
    path.write_bytes(exr_bytes[: int(len(exr_bytes) * part)])
    with pytest.raises(CorruptFrameError, match=r"cut\.exr.*run the generation command again"):
        read_exr(path, CHANNELS, (40, 33))


@settings(max_examples=60, deadline=None)
@given(position=st.integers(0, 1 << 20), value=st.integers(1, 255))
def test_a_mutated_exr_never_crashes(tmp_path_factory, exr_bytes: bytes, position: int, value: int) -> None:
    path = tmp_path_factory.getbasetemp() / "mutated.exr"
    data = bytearray(exr_bytes)
    data[position % len(data)] ^= value
    path.write_bytes(bytes(data))
    try:
        image = read_exr(path, CHANNELS, (40, 33))
    except CorruptFrameError:
        return
    assert np.isfinite(image).all()


def test_a_missing_or_wrong_frame_says_so(tmp_path: Path, exr_bytes: bytes) -> None:
    with pytest.raises(FileNotFoundError, match="frame is missing"):
        read_exr(tmp_path / "none.exr", CHANNELS)
    (tmp_path / "a.exr").write_bytes(exr_bytes)
    with pytest.raises(CorruptFrameError, match=r"channels \['top'\] are missing"):
        read_exr(tmp_path / "a.exr", ("top",))
    with pytest.raises(CorruptFrameError, match="expected"):
        read_exr(tmp_path / "a.exr", CHANNELS, (8, 8))


def test_values_that_half_cannot_hold_are_refused(tmp_path: Path) -> None:
    for bad in (np.nan, 1e6):
        with pytest.raises(ValueError, match="half floats"):
            write_exr(tmp_path / "b.exr", np.full((2, 2, 1), bad, np.float32), ("alpha",))
    assert not os.listdir(tmp_path)


def test_srgb_inverts_and_meets_its_fixed_points() -> None:
    linear = np.concatenate([np.linspace(0.0, 0.01, 500), np.linspace(0.0, 4.0, 500)])
    np.testing.assert_allclose(decode_srgb(encode_srgb(linear)), linear, atol=1e-7)
    np.testing.assert_allclose(encode_srgb(np.array([0.0, 0.0031308, 0.5, 1.0])), [0, 0.04045, 0.735357, 1], atol=1e-5)
    assert (encode_srgb(np.array([-1.0])) == encode_srgb(np.array([0.0]))).all()


def test_records_refuse_what_they_cannot_mean() -> None:
    grid = Grid.centred((2, 2, 2))
    with pytest.raises(ValueError, match="dtype float64"):
        DensityFrame(density=np.zeros((2, 2, 2)), grid=grid)
    with pytest.raises(ValueError, match="expected"):
        DensityFrame(density=np.zeros((2, 2, 3), np.float32), grid=grid)
    with pytest.raises(ValueError, match="1 NaN"):
        bad = np.zeros((2, 2, 2), np.float32)
        bad[0, 0, 0] = np.nan
        DensityFrame(density=bad, grid=grid)
    with pytest.raises(ValueError, match="holds"):
        SixWayLightmap(channels=("right",), image=np.zeros((2, 2, 1), np.float32))
    with pytest.raises(ValueError, match="twice"):
        GuideMap(
            channels=("depth", "depth"), image=np.zeros((2, 2, 2), np.float32), depth_m=np.zeros((2, 2), np.float32)
        )


@given(
    pieces=st.lists(
        st.tuples(st.integers(0, 3 * 4096), st.integers(0, 9000)).map(lambda sizes: bytes(sizes[0]) + b"a" * sizes[1]),
        max_size=5,
    )
)
def test_a_file_with_holes_reads_as_what_was_written(tmp_path_factory: pytest.TempPathFactory, pieces: Any) -> None:
    path = tmp_path_factory.mktemp("holes") / "file"
    with path.open("wb") as file:
        for piece in pieces:
            write_with_holes(file, piece)
        file.truncate(file.tell())
    assert path.read_bytes() == b"".join(pieces)


def test_empty_blocks_take_no_disk(tmp_path: Path) -> None:
    hole, path = tmp_path / "hole", tmp_path / "file"
    with hole.open("wb") as file:
        file.truncate(1 << 20)
    if hole.stat().st_blocks > 0:
        pytest.skip("this file system keeps no holes")
    with path.open("wb") as file:
        write_with_holes(file, b"x" + bytes(1 << 20))
        file.truncate(file.tell())
        os.fsync(file.fileno())  # blocks that are not on the disk yet may not count
    assert path.stat().st_size == 1 + (1 << 20)
    assert 0 < path.stat().st_blocks * 512 < 1 << 16


def claim(folder: Path, settings: dict[str, Any], *, replace: bool = False, frames: int = 2) -> list[str]:
    files = [folder / f"frame_{number}.txt" for number in range(frames)]
    missing = claim_folder(
        folder, files, record="made.json", settings=settings, patterns=("frame_*.txt",), replace=replace
    )
    return [file.name for file in missing]


def test_the_same_settings_find_their_files_again(tmp_path: Path) -> None:
    assert claim(tmp_path, {"a": (1, 2), "b": {"c": 0.5}}) == ["frame_0.txt", "frame_1.txt"]
    (tmp_path / "frame_0.txt").write_text("made")
    assert claim(tmp_path, {"b": {"c": 0.5}, "a": (1, 2)}) == ["frame_1.txt"]


def test_other_settings_are_refused_by_name_until_told_to_replace(tmp_path: Path) -> None:
    claim(tmp_path, {"b": {"c": 0.5}})
    (tmp_path / "frame_0.txt").write_text("hours of work")
    with pytest.raises(ValueError, match=r"1 file.*frame_0.txt.*b.c: 0.5 there, 0.7 here.*--replace"):
        claim(tmp_path, {"b": {"c": 0.7}})
    assert (tmp_path / "frame_0.txt").read_text() == "hours of work"
    assert claim(tmp_path, {"b": {"c": 0.7}}, replace=True) == ["frame_0.txt", "frame_1.txt"]
    assert claim(tmp_path, {"b": {"c": 0.7}}) == ["frame_0.txt", "frame_1.txt"]


def test_files_of_nobody_and_of_earlier_versions_are_not_deleted_silently(tmp_path: Path) -> None:
    (tmp_path / "frame_1.txt").write_text("somebody's")
    with pytest.raises(ValueError, match="that this command did not make"):
        claim(tmp_path, {"a": 1})
    write_json(tmp_path / "made.json", {"made_by": "0123456789ab"})
    with pytest.raises(ValueError, match="earlier version, which kept no settings"):
        claim(tmp_path, {"a": 1})
    assert (tmp_path / "frame_1.txt").read_text() == "somebody's"


def test_settings_whose_files_were_never_made_leave_the_folder_free(tmp_path: Path) -> None:
    claim(tmp_path, {"a": 1})
    assert claim(tmp_path, {"a": 2}) == ["frame_0.txt", "frame_1.txt"]
