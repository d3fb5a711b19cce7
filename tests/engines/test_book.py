"""Files: every packing and format returns what it carries, sidecars are not trusted, PNGs of 16 bits are whole."""

import io
import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr, write_exr
from sixway.engines.book import Book, BookStyle, read_book, sidecar_path, write_book
from sixway.engines.flipbook import TileGrid, every_frame
from sixway.engines.packing import PACKINGS
from sixway.engines.png16 import read_png16, write_png16
from sixway.engines.texture import read_picture
from sixway.pack import main as pack_main
from sixway.unpack import main as unpack_main


@pytest.fixture
def frames(rng: np.random.Generator) -> np.ndarray:
    """Five frames [n, 8, 12, 8] that half floats hold exactly, premultiplied."""
    image = rng.uniform(0.0, 1.0, (5, 8, 12, 8))
    image[..., :6] *= image[..., 6:7]
    return image.astype(np.float16).astype(np.float32)


def written(folder: Path, frames: np.ndarray, **style: object) -> Path:
    prefix = folder / "smoke"
    chosen = BookStyle(**{"packing": PACKINGS["unity"], "kind": "exr", "grid": TileGrid(3, 2), **style})
    write_book(
        prefix,
        chosen,
        plan=every_frame(len(frames)),
        channels=LIGHTMAP_CHANNELS,
        shape_px=frames.shape[1:3],
        read=lambda number: frames[number],
    )
    return sidecar_path(prefix)


def carried(book: Book, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    names = [name for name in book.channels if name in LIGHTMAP_CHANNELS]
    got = book.frames[..., [book.channels.index(name) for name in names]]
    return got, frames[..., [LIGHTMAP_CHANNELS.index(name) for name in names]]


@pytest.mark.parametrize("kind", ["exr", "dds_rgba16f"])
@pytest.mark.parametrize("name", PACKINGS)
def test_half_floats_come_back_bit_by_bit(name: str, kind: str, frames: np.ndarray, tmp_path: Path) -> None:
    book = read_book(written(tmp_path, frames, packing=PACKINGS[name], kind=kind))
    got, expected = carried(book, frames)
    np.testing.assert_array_equal(got, expected)
    assert set(book.channels) == set(PACKINGS[name].carried)


@pytest.mark.parametrize(("kind", "levels"), [("png", 255), ("tga", 255), ("dds_rgba8", 255), ("png16", 65535)])
@pytest.mark.parametrize("name", PACKINGS)
def test_whole_numbers_come_back_within_their_step(
    name: str, kind: str, levels: int, frames: np.ndarray, tmp_path: Path
) -> None:
    packing = PACKINGS[name]
    book = read_book(written(tmp_path, frames, packing=packing, kind=kind))
    for texture in packing.textures:
        for i, channel in enumerate(texture.channels):
            if channel not in LIGHTMAP_CHANNELS:
                continue
            got, expected = (
                book.frames[..., book.channels.index(channel)],
                frames[..., LIGHTMAP_CHANNELS.index(channel)],
            )
            if texture.transfer(i) == "srgb":
                got, expected = encode_srgb(got), encode_srgb(expected)
            assert np.abs(got - expected).max() <= 0.5 / levels + 1e-5


def test_bc7_keeps_a_picture(frames: np.ndarray, tmp_path: Path) -> None:
    pytest.importorskip("etcpak", reason="the extra 'textures' is not installed")
    y, x = np.mgrid[:16, :16] / 16
    smooth = np.stack([np.stack([x, y, x * y, 1 - x, y, x, 0 * x + 0.5, 0 * x], axis=-1)] * 5).astype(np.float32)
    book = read_book(written(tmp_path, smooth, kind="dds_bc7"))
    got, expected = carried(book, smooth)
    assert np.sqrt(np.mean((got - expected) ** 2)) < 0.05  # four unlike ramps in 4 x 4 px; exchanged channels give 0.3


def test_bc7_without_its_library_says_what_to_install(
    frames: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "etcpak", None)
    square = np.repeat(frames[:, :, :8], 1, axis=2)
    with pytest.raises(ValueError, match="pip install 'sixway\\[textures\\]'"):
        written(tmp_path, square, kind="dds_bc7")
    with pytest.raises(ValueError, match="blocks of 4"):
        written(tmp_path, frames[:, :7, :7], kind="dds_bc7")


@pytest.mark.parametrize("kind", ["exr", "dds_rgba16f"])
def test_arrays_come_back_slice_by_slice(kind: str, frames: np.ndarray, tmp_path: Path) -> None:
    path = written(tmp_path, frames, grid=None, kind=kind)
    got, expected = carried(read_book(path), frames)
    np.testing.assert_array_equal(got, expected)
    assert len(json.loads(path.read_text())["files"]) == (10 if kind == "exr" else 2)


def test_straight_maps_and_brightness_are_undone(frames: np.ndarray, tmp_path: Path) -> None:
    book = read_book(written(tmp_path, frames, alpha="straight", brightness=0.5, emissive_brightness=0.25))
    got, expected = carried(book, frames)
    np.testing.assert_allclose(got, expected, atol=2e-3)


def test_sidecar_says_what_pixels_cannot(frames: np.ndarray, tmp_path: Path) -> None:
    said = json.loads(written(tmp_path, frames, kind="png", fps=30.0).read_text())
    assert said["textures"][0] == {
        "suffix": "RTBA",
        "channels": ["right", "top", "back", "alpha"],
        "transfer": ["srgb", "srgb", "srgb", "linear"],
    }
    assert (said["grid"], said["tile_px"], said["frames"], said["fps"]) == ({"columns": 3, "rows": 2}, [12, 8], 5, 30.0)
    assert "A always linear" in said["transfer_meaning"] and "transmittance" in said["alpha_meaning"]


def set_in(tree: dict, path: str, value: object) -> None:
    *parents, last = [int(p) if p.isdigit() else p for p in path.split(".")]
    node = tree
    for part in parents:
        node = node[part]
    node[last] = value


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("files.0.name", "../smoke_RTBA.exr", "has a folder in it"),
        ("files.0.name", "/etc/passwd", "has a folder in it"),
        ("files.0.name", "..", "has a folder|outside|there is no|missing"),
        ("files.0.textures", [7], "there are 2"),
        ("files.0.sha256", "0" * 64, "--accept-edited"),
        ("frames", 7, "do not fit the grid"),
        ("frames", 10**9, "frames"),
        ("tile_px", [6, 8], "the sidecar says"),
        ("grid", {"columns": 5, "rows": 1}, "whole pixels"),
        ("grid", {"columns": 10**6, "rows": 1}, "columns"),
        ("brightness", 0.0, "brightness"),
        ("textures.0.channels", ["right", "top", "rear", "alpha"], "rear"),
        ("textures.0.transfer", ["srgb", "srgb", "srgb", "srgb"], "A is linear"),
        ("textures.0.transfer", ["srgb"], "one curve"),
        ("colour", 1, "unknown key"),
        ("version", 2, "version"),
    ],
)
def test_hostile_sidecars_are_refused(key: str, value: object, said: str, frames: np.ndarray, tmp_path: Path) -> None:
    path = written(tmp_path, frames)
    tree = json.loads(path.read_text())
    set_in(tree, key, value)
    path.write_text(json.dumps(tree))
    with pytest.raises((ValueError, FileNotFoundError), match=said):
        read_book(path)


def test_a_missing_sidecar_or_texture_is_named(frames: np.ndarray, tmp_path: Path) -> None:
    path = written(tmp_path, frames)
    (tmp_path / "smoke_RTBA.exr").unlink()
    with pytest.raises(FileNotFoundError, match="smoke_RTBA.exr"):
        read_book(path)
    path.unlink()
    with pytest.raises(FileNotFoundError, match="no sidecar"):
        read_book(path)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png16_keeps_every_bit(channels: int, rng: np.random.Generator, tmp_path: Path) -> None:
    pixels = rng.integers(0, 65536, (7, 5, channels)).astype(np.uint16)
    write_png16(tmp_path / "a.png", pixels)
    np.testing.assert_array_equal(read_png16(tmp_path / "a.png", largest_pixels=100), pixels)
    if channels == 1:  # Pillow reads grey of 16 bits itself
        np.testing.assert_array_equal(np.array(Image.open(tmp_path / "a.png")), pixels[..., 0])
    with pytest.raises(ValueError, match="limit"):
        read_png16(tmp_path / "a.png", largest_pixels=30)


@pytest.mark.parametrize("kind", range(5))
def test_png16_undoes_every_filter(kind: int, rng: np.random.Generator, tmp_path: Path) -> None:
    """Against filters written out one byte at a time, as the specification has them."""
    pixels = rng.integers(0, 65536, (4, 6, 3)).astype(np.uint16)
    rows, step = pixels.astype(">u2").tobytes(), 6
    width = 6 * step
    raw = b""
    for y in range(4):
        line, above = rows[y * width : (y + 1) * width], rows[(y - 1) * width : y * width] if y else bytes(width)
        out = []
        for x in range(width):
            a, b, c = (line[x - step] if x >= step else 0), above[x], (above[x - step] if x >= step else 0)
            nearest = min((a, b, c), key=lambda v, p=a + b - c: abs(p - v))
            out.append((line[x] - (0, a, b, (a + b) // 2, nearest)[kind]) % 256)
        raw += bytes([kind, *out])

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", 6, 4, 16, 2, 0, 0, 0)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    np.testing.assert_array_equal(read_png16(tmp_path / "a.png", largest_pixels=100), pixels)


def test_foreign_textures_are_refused_with_a_remedy(tmp_path: Path) -> None:
    palette = tmp_path / "palette.png"
    Image.new("P", (4, 4)).save(palette)
    with pytest.raises(ValueError, match="palette"):
        read_picture(palette)
    whole = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (32, 32, 4), np.uint8)).save(whole, "PNG")
    for name, data, said in (
        ("cut.png", whole.getvalue()[:500], "export it again"),
        ("junk.tga", b"no picture", "export it again"),
        ("junk.exr", b"no picture", "readable EXR"),
        ("junk.dds", b"DDS " + bytes(200), "DX10"),
        ("a.webp", b"", "cannot read"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ValueError, match=said):
            read_picture(tmp_path / name)
    with pytest.raises(FileNotFoundError, match="no such texture"):
        read_picture(tmp_path / "none.png")


@pytest.fixture
def bake(frames: np.ndarray, tmp_path: Path) -> Path:
    for i, frame in enumerate(frames):
        write_exr(tmp_path / f"maps/frame_{i:04d}.exr", frame, LIGHTMAP_CHANNELS)
    return tmp_path / "maps"


def test_commands_pack_and_unpack_a_bake(bake: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        f"{bake}/frame_*.exr",
        "--packing",
        "unity",
        "--out",
        f"{tmp_path}/smoke",
        "--grid",
        "3x2",
        "--format",
        "exr",
    ]
    assert pack_main([*arguments, "--dry-run"]) == 0
    assert not (tmp_path / "smoke.json").exists() and "smoke_RTBA.exr" in capsys.readouterr().out
    assert pack_main(arguments) == 0
    assert unpack_main([f"{tmp_path}/smoke.json", "--out", f"{tmp_path}/back"]) == 0
    for i in range(5):
        before, after = (read_exr(f / f"frame_{i:04d}.exr", LIGHTMAP_CHANNELS) for f in (bake, tmp_path / "back"))
        np.testing.assert_array_equal(before, after)


def test_loop_retime_and_borders_reach_the_files(bake: Path, tmp_path: Path) -> None:
    out = f"{tmp_path}/loop"
    styled = "--loop 2 --retime 6 --fix-borders 2 --fps 30 --format exr".split()
    assert pack_main([str(bake), "--out", out, *styled]) == 0
    book = read_book(Path(f"{out}.json"))
    assert book.sidecar.loop and len(book.frames) == 6 and book.sidecar.fps == pytest.approx(60.0)
    rims = np.concatenate([book.frames[:, 0].ravel(), book.frames[:, :, -1].ravel()])
    assert np.all(rims == 0.0) and book.frames.max() > 0.1


def test_brightness_auto_reaches_one_and_clipping_is_told(
    bake: Path, tmp_path: Path, frames: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pack_main([str(bake), "--out", f"{tmp_path}/a", "--brightness", "auto"]) == 0
    brightest = frames[..., : len(DIRECTIONS)].max()
    assert json.loads((tmp_path / "a.json").read_text())["brightness"] == pytest.approx(1.0 / brightest)
    assert "clipped" not in capsys.readouterr().out
    assert pack_main([str(bake), "--out", f"{tmp_path}/a", "--brightness", "3"]) == 0
    assert "clipped" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing_*.exr"], "no .exr frames"),
        (["{maps}", "--grid", "2x2"], "do not fit a grid"),
        (["{maps}", "--packing", "unitee"], "take one of"),
        (["{maps}", "--brightness", "bright"], "positive number or auto"),
        (["{maps}", "--frames", "9:"], "hold a frame"),
        (["{maps}", "--fix-borders", "9"], "narrower"),
        (["{maps}", "--fps", "0"], "--fps"),
    ],
)
def test_pack_says_what_is_wrong(
    arguments: list[str], said: str, bake: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    filled = [argument.format(maps=bake) for argument in arguments]
    assert pack_main([*filled, "--out", f"{tmp_path}/x"]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.glob("x*"))
