"""Textures that were resized, converted or mixed up after they were packed: each is refused by name, with a remedy."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.exr import write_exr
from sixway.engines.book import read_book
from sixway.engines.png16 import write_png16
from sixway.engines.validate import main as validate_main
from sixway.pack import main as pack_main
from sixway.unpack import main as unpack_main


@pytest.fixture
def maps(tmp_path: Path, rng: np.random.Generator) -> Path:
    for number in range(4):
        frame = rng.uniform(0.0, 1.0, (8, 8, 8)).astype(np.float32)
        write_exr(tmp_path / f"maps/frame_{number:04d}.exr", frame, LIGHTMAP_CHANNELS)
    return tmp_path / "maps"


@pytest.fixture
def packed(maps: Path, tmp_path: Path) -> Path:
    assert pack_main([str(maps), "--out", f"{tmp_path}/smoke", "--grid", "2x2"]) == 0
    return tmp_path / "smoke.json"


def resized(path: Path) -> None:
    Image.open(path).resize((32, 32)).save(path)


def cropped(path: Path) -> None:
    Image.open(path).crop((0, 0, 15, 15)).save(path)


def to_palette(path: Path) -> None:
    Image.open(path).convert("RGB").quantize(16).save(path)


def without_alpha(path: Path) -> None:
    Image.open(path).convert("RGB").save(path)


def to_grey_and_alpha(path: Path) -> None:
    Image.open(path).convert("LA").save(path)


def renamed_jpeg(path: Path) -> None:
    Image.open(path).convert("CMYK").save(path, format="JPEG")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (resized, r"hold \[\(4, 8, 8\), \(4, 16, 16\)\].*4 of 8x8"),
        (cropped, "does not hold 2x2 tiles of whole pixels; give the grid"),
        (to_palette, "palette or other.*save it as 8-bit grey, RGB or RGBA"),
        (to_grey_and_alpha, "'LA'.*save it as"),
        (without_alpha, "holds 3 channels, texture LBFE has 4.*export it as RGBA"),
        (renamed_jpeg, "'CMYK'.*save it as"),
    ],
)
def test_spoiled_textures_are_refused(packed: Path, spoil: Callable[[Path], None], said: str) -> None:
    texture = packed.with_name("smoke_LBFE.png")
    spoil(texture)
    with pytest.raises(ValueError, match="--accept-edited"):
        read_book(packed)
    with pytest.raises(ValueError, match=said):
        read_book(packed, accept_edited=True)


def test_a_texture_saved_with_16_bits_reads_as_the_same(packed: Path) -> None:
    before = read_book(packed).frames
    texture = packed.with_name("smoke_LBFE.png")
    write_png16(texture, np.asarray(Image.open(texture)).astype(np.uint16) * 257)
    np.testing.assert_allclose(read_book(packed, accept_edited=True).frames, before, atol=1e-6)


def test_a_stack_of_odd_height_is_refused(maps: Path, tmp_path: Path) -> None:
    out = f"{tmp_path}/stack"
    assert pack_main([str(maps), "--out", out, "--grid", "2x2", "--packing", "paradox_stacked"]) == 0
    cropped(tmp_path / "stack_RTB_LBF.png")
    with pytest.raises(ValueError, match="15 rows do not hold 2 textures of whole pixels"):
        read_book(Path(f"{out}.json"), accept_edited=True)


def test_frames_of_different_sizes_make_no_book(maps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_exr(maps / "frame_0002.exr", np.ones((8, 6, 8), np.float32), LIGHTMAP_CHANNELS)
    assert pack_main([str(maps), "--out", f"{tmp_path}/x"]) == 2
    error = capsys.readouterr().err
    assert "frame_0002.exr" in error and "(8, 6)" in error and "(8, 8)" in error
    assert not list(tmp_path.glob("x*"))


def test_a_texture_in_the_place_of_its_sidecar(packed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    texture = packed.with_name("smoke_RTBA.png")
    assert unpack_main([str(texture), "--out", str(packed.parent / "back")]) == 2
    assert "give the .json" in capsys.readouterr().err
    packed.unlink()
    assert unpack_main([str(packed), "--out", str(packed.parent / "back")]) == 2
    assert "there is no sidecar" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "grid", "said"),
    [
        (("smoke_RTBA.png", "smoke_LBFE.png"), "3x3", "whole pixels"),
        (("smoke_RTBA.png", "palette.png"), "2x2", "palette"),
        (("smoke_RTBA.png", "small.png"), "2x2", "differ in size"),
        (("smoke_RTBA.png", "none.png"), "2x2", "no such texture"),
        (("smoke_RTBA.png", "float.exr"), "2x2", "some of the textures hold floats"),
    ],
)
def test_the_validator_refuses_what_is_no_pair(
    names: tuple[str, str], grid: str, said: str, packed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = packed.parent
    Image.new("P", (16, 16)).save(folder / "palette.png")
    Image.new("RGBA", (8, 8)).save(folder / "small.png")
    assert pack_main([str(folder / "maps"), "--out", f"{folder}/f", "--grid", "2x2", "--format", "exr"]) == 0
    (folder / "f_LBFE.exr").rename(folder / "float.exr")
    assert validate_main([*(str(folder / name) for name in names), "--grid", grid]) == 2
    assert said in capsys.readouterr().err
