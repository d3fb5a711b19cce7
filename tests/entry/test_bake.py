"""The classic tool: volumes to path-traced maps, resumable, framed as one sequence."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixway.bake import SHEET, main
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr, read_exr_attributes
from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.shading.fire import ArtistRamp, fire_colour
from sixway.shading.sheet import lightmap_sheet
from sixway.simulate import main as simulate
from sixway.volumes.npz import write_npz
from sixway.volumes.read import CHECKPOINT

JET = Path(__file__).parents[1] / "data/jet.npz"
CHANNELS = LIGHTMAP_CHANNELS[:-1]
SMALL = ("--resolution", "20x16", "--samples", "1")
PUFF = """\
name: puff
resolution: {cells: 12, refinement: 2}
frames: 2
warmup_frames: 2
inlets:
  - {centre_m: [0.0, -0.5, 0.0], radius_m: 0.15}
"""


def bake(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


@pytest.fixture
def wandering(tmp_path: Path) -> Path:
    """Three small boxes of smoke, each in a file whose grid covers it alone, further and further right."""
    folder = tmp_path / "volumes"
    for number in range(3):
        grid = Grid(shape_zyx=(6, 6, 6), voxel_size_m=0.1, origin_m=(0.6 * number, 0.0, 0.0))
        write_npz(folder / f"smoke_{number}.npz", DensityFrame(density=np.ones((6, 6, 6), np.float32), grid=grid))
    return folder


def test_the_jet_is_baked_with_its_light_on_the_right_side(tmp_path: Path) -> None:
    assert bake(JET, "--out", tmp_path / "maps", *SMALL) == 0
    path = tmp_path / "maps/frame_0000.exr"
    maps = dict(zip(CHANNELS, np.moveaxis(read_exr(path, CHANNELS, (16, 20)), -1, 0), strict=True))
    columns = np.arange(20)

    def centre(name: str) -> float:
        return float((maps[name].sum(0) * columns).sum() / maps[name].sum())

    assert centre("right") > centre("front") > centre("left")
    assert 0.5 < maps["alpha"].max() <= 1.0
    assert read_exr_attributes(path)["sixway/bounces"] == "paper"


def test_a_sequence_is_framed_once_and_resumes(wandering: Path, tmp_path: Path) -> None:
    out = tmp_path / "maps"
    arguments = (wandering, "--out", out, "--bounces", "single", *SMALL)
    assert bake(*arguments) == 0
    files = sorted(out.glob("*.exr"))
    alphas = [read_exr(file, ("alpha",))[..., 0] for file in files]
    centres = [float((a.sum(0) * np.arange(20)).sum() / a.sum()) for a in alphas]
    assert centres[0] + 3.0 < centres[1] < centres[2] - 3.0  # the camera does not follow the smoke
    assert alphas[0].sum() == pytest.approx(alphas[2].sum(), rel=0.1)
    old = {file: file.stat().st_mtime_ns for file in files}
    files[1].unlink()
    assert bake(*arguments) == 0
    assert [file.stat().st_mtime_ns != old[file] for file in files] == [False, True, False]
    np.testing.assert_array_equal(read_exr(files[1], ("alpha",))[..., 0], alphas[1])


def test_the_folder_of_a_simulation_is_baked_frame_by_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Beside its frames, each in two formats here, it holds the state that the simulation goes on from."""
    (tmp_path / "puff.yaml").write_text(PUFF)
    folder, out = tmp_path / "puff", tmp_path / "maps"
    arguments = ["--out", str(folder), "--format", "npz", "nvdb", "--checkpoint-every", "1", "--no-strip"]
    assert simulate([str(tmp_path / "puff.yaml"), *arguments]) == 0
    assert (folder / CHECKPOINT).is_file()
    assert bake(folder, "--out", out, "--bounces", "single", "--motion", *SMALL) == 0
    assert "2 volume(s)" in capsys.readouterr().out
    assert [path.name for path in sorted(out.glob("*.exr"))] == ["frame_0000.exr", "frame_0001.exr"]
    named = tmp_path / "named"
    assert bake(folder / "frame_*.npz", "--out", named, "--bounces", "single", "--motion", *SMALL) == 0
    for name in ("frame_0000.exr", "frame_0001.exr"):
        np.testing.assert_array_equal(read_exr(out / name, CHANNELS), read_exr(named / name, CHANNELS))


def test_other_settings_are_refused_or_replace(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "maps"
    first = (JET, "--out", out, "--bounces", "single", *SMALL)
    assert bake(*first) == 0
    bytes_before = (out / "frame_0000.exr").read_bytes()
    white = read_exr(out / "frame_0000.exr", ("front",))
    assert bake(*first, "--albedo", "0.5") == 2
    told = capsys.readouterr().err
    assert "medium.albedo: 1.0 there, 0.5 here" in told and "--replace" in told
    assert (out / "frame_0000.exr").read_bytes() == bytes_before
    assert bake(*first, "--albedo", "0.5", "--replace") == 0
    grey = read_exr(out / "frame_0000.exr", ("front",))
    np.testing.assert_allclose(grey, 0.5 * white, rtol=2e-3, atol=1e-5)


def test_a_volume_that_was_only_touched_is_the_same(tmp_path: Path) -> None:
    """So does a copy of the repository: what counts is the bytes of the file."""
    volume, out = tmp_path / "jet.npz", tmp_path / "maps"
    volume.write_bytes(JET.read_bytes())
    command = (volume, "--out", out, "--bounces", "single", *SMALL)
    assert bake(*command) == 0
    made = (out / "frame_0000.exr").stat().st_mtime_ns
    os.utime(volume, ns=(1, 1))
    assert bake(*command, "--device", "cpu") == 0
    assert (out / "frame_0000.exr").stat().st_mtime_ns == made


def test_a_dry_run_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert bake(JET, "--out", tmp_path / "maps", "--dry-run") == 0
    assert "density scale" in capsys.readouterr().out
    assert not (tmp_path / "maps").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--albedo", "1.5"), "albedo 1.5 must be one number in"),
        (("--samples", "0"), "samples: input should be greater than or equal to 1"),
        (("--resolution", "0"), "size '0' is not N or WxH"),
        (("--frames", "3:9"), "--frames '3:9' is not A:B"),
        (("--optical-depth", "-1"), "--optical-depth -1.0 must be positive"),
        (("--emission", "flame"), "holds no grid 'flame'"),
        (("--emission-scale", "0"), "--emission-scale 0.0 must be positive"),
        (("--emission-threshold", "-1"), "emission threshold -1.0 must be 0 or positive"),
        (("--self-lit",), "--self-lit: these volumes hold no fire"),
        (("--camera-pitch", "90"), "pitch 90.0 deg must lie strictly between"),
    ],
)
def test_bad_options_are_told_once(
    arguments: tuple[str, str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bake(JET, "--out", tmp_path / "maps", *arguments) == 2
    told = capsys.readouterr().err
    assert says in told
    assert told.count("error:") == 1
    assert not (tmp_path / "maps").exists()


@pytest.fixture
def burning(tmp_path: Path) -> Path:
    """Two boxes of smoke: one burns in its left half, the other is burnt out."""
    folder = tmp_path / "fire"
    folder.mkdir()
    flame = np.zeros((8, 8, 8), np.float32)
    flame[..., :4] = 0.5
    for number, fire in enumerate((flame, 0.0 * flame)):
        density = np.full((8, 8, 8), 0.2, np.float32)
        np.savez(folder / f"fire_{number}.npz", density=density, flame=fire, voxel_size_m=0.1)
    return folder


def test_fire_has_its_layer_its_own_light_and_a_place_in_the_sheet(
    burning: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "maps"
    arguments = (burning, "--out", out, "--bounces", "single", "--optical-depth", "2", *SMALL)
    assert bake(*arguments, "--self-lit") == 0
    assert "fire of" in capsys.readouterr().out
    files = sorted(out.glob("*.exr"))
    fire, glow, front = np.moveaxis(read_exr(files[0], ("emissive", "self_lit", "front")), -1, 0)
    assert fire[:, :10].sum() > 20.0 * fire[:, 11:].sum()
    assert glow[:, :10].sum() > 1.5 * glow[:, 11:].sum() > 0.0  # it lights the smoke beside it
    assert front.max() > 0.0
    burnt_out = read_exr(files[1], ("emissive", "self_lit"))
    assert not burnt_out.any()
    with Image.open(out / SHEET) as sheet:
        assert sheet.size == (9 * (144 + 4) + 4, 2 * (115 + 18 + 4) + 2 * 18)
        pixels = np.asarray(sheet).astype(int)
    emissive = pixels[36 : 36 + 115, 4 + 7 * 148 : 4 + 8 * 148]
    assert (emissive[..., 0] - emissive[..., 2]).max() > 60  # in the colours of fire
    assert bake(*arguments, "--emission", "none", "--replace") == 0
    with pytest.raises(ValueError, match="emissive"):
        read_exr(files[0], ("emissive",))


def test_the_strength_of_fire_can_be_told(burning: Path, tmp_path: Path) -> None:
    sums = []
    for scale in ("1", "3"):
        out = tmp_path / scale
        assert bake(burning, "--out", out, "--bounces", "single", "--emission-scale", scale, *SMALL) == 0
        sums.append(float(read_exr(out / "frame_0000.exr", ("emissive",)).sum()))
    assert sums[1] == pytest.approx(3.0 * sums[0], rel=2e-3)


def test_a_sheet_shows_alpha_as_it_is_and_light_at_one_exposure() -> None:
    flat = np.ones((4, 6), np.float32)
    maps = {name: 0.5 * flat for name in CHANNELS[:-1]} | {"alpha": 0.25 * flat, "emissive": flat}
    maps["left"] = 0.25 * flat
    ramp = ArtistRamp(stops=((2.0, (0.5, 0.1, 0.0)),))
    sheet = lightmap_sheet([("one", maps)], fire=ramp, tile_px=60)
    step = 64

    def tile(column: int) -> np.ndarray:
        return sheet[36 + 20, 4 + column * step + 30]

    assert (tile(0) == 255).all()  # the brightest maps are white
    assert (tile(1) == 188).all()  # half of that: sRGB of 0.5
    assert (tile(6) == 64).all()
    assert fire_colour(2.0 * flat, ramp)[0, 0, 0] == pytest.approx(0.5)
    assert tile(7)[0] == 188 and tile(7)[2] == 0
