"""`python -m sixway.relight`: any volume, lit, as a picture, a folder that resumes, or a video."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from sixway import relight

JET = Path(__file__).parents[1] / "data/jet.npz"
SMALL = ("--size", "32x28")


def read(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image).astype(float)


def listed(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def halves(picture: np.ndarray) -> tuple[float, float]:
    """Mean of the left and of the right half."""
    middle = picture.shape[1] // 2
    return picture[:, :middle].mean(), picture[:, middle:].mean()


def test_our_own_smoke_becomes_a_picture(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    path = tmp_path / "a/b/out.png"
    done = run("relight", JET, "--checkpoint", trained_run, "--light", "right,1,0.9,0.8", *SMALL, "-o", path)
    assert (done.status, done.err) == (0, "")
    assert str(path) in done.out
    scale = re.search(r"density scale ([0-9.e+]+) 1/m", done.out)
    assert scale and float(scale[1]) > 0.0
    picture = read(path)
    assert picture.shape == (28, 32, 3)
    assert picture.max() > 100.0 and picture.std() > 10.0
    np.testing.assert_allclose(picture[0, 0], (63, 79, 101), atol=6)  # the background, in sRGB
    first = path.read_bytes()
    assert (
        run("relight", JET, "--checkpoint", trained_run, "--light", "right,1,0.9,0.8", *SMALL, "-o", path).status == 0
    )
    assert path.read_bytes() == first  # the same command, the same bytes
    assert listed(tmp_path / "a") == ["b", "out.png"]


def test_smoke_is_bright_towards_its_light(run: Callable, trained_run: Path, ball: Path, tmp_path: Path) -> None:
    lit = {}
    for light in ("right", "left", "top", "bottom"):
        path = tmp_path / f"{light}.png"
        black = ("--background", "0,0,0")
        assert (
            run("relight", ball, "--checkpoint", trained_run, "--light", light, *black, *SMALL, "-o", path).status == 0
        )
        lit[light] = read(path)
    left, right = halves(lit["right"])
    assert right > 1.1 * left
    left, right = halves(lit["left"])
    assert left > 1.1 * right
    assert halves(lit["right"] - lit["left"])[1] > 5.0 > -5.0 > halves(lit["right"] - lit["left"])[0]
    upper, lower = halves(np.swapaxes(lit["top"] - lit["bottom"], 0, 1))
    assert upper > 5.0 > -5.0 > lower


def test_a_light_may_begin_with_a_minus(run: Callable, trained_run: Path, ball: Path, tmp_path: Path) -> None:
    common = (ball, "--checkpoint", trained_run, *SMALL)
    assert run("relight", *common, "--light", "-1:0:0", "-o", tmp_path / "vector.png").status == 0
    assert run("relight", *common, "--light", "left", "-o", tmp_path / "name.png").status == 0
    assert (tmp_path / "vector.png").read_bytes() == (tmp_path / "name.png").read_bytes()
    assert (
        run("relight", *common, "--camera-yaw", "-30", "--light", "-.5:1:0,1,0,0", "-o", tmp_path / "b.png").status == 0
    )


def test_lights_add_and_colour(run: Callable, trained_run: Path, ball: Path, tmp_path: Path) -> None:
    common = (ball, "--checkpoint", trained_run, *SMALL, "--background", "0,0,0")
    two = ("--light", "right,1,0,0", "--light", "left,0,0,1")
    assert run("relight", *common, *two, "-o", tmp_path / "two.png").status == 0
    assert run("relight", *common, "--light", "right,1,0,0", "-o", tmp_path / "one.png").status == 0
    both, red = read(tmp_path / "two.png"), read(tmp_path / "one.png")
    np.testing.assert_array_equal(both[..., 0], red[..., 0])
    assert both[..., 1].max() == 0.0 and red[..., 2].max() == 0.0 and both[..., 2].max() > 50.0


def test_lamps_light_the_side_they_stand_on_and_fade(
    run: Callable, trained_run: Path, ball: Path, tmp_path: Path
) -> None:
    common = (ball, "--checkpoint", trained_run, *SMALL, "--background", "0,0,0")
    lights = {
        "near": ("point@1.2:0:0.3",),
        "far": ("point@2.4:0:0.6",),
        "aimed away": ("spot@2:0:0@3:0:0",),
        "panel": ("rectangle@-2:0:0@0:0:0,3,3,3,size=2x2",),
        "line": ("line@-1:-1.5:0@1:-1.5:0",),
    }
    lit = {}
    for name, texts in lights.items():
        path = tmp_path / f"{name}.png"
        arguments = [part for text in texts for part in ("--light", text)]
        assert run("relight", *common, *arguments, "-o", path).status == 0
        lit[name] = read(path)
    left, right = halves(lit["near"])
    assert right > 1.1 * left
    assert lit["far"].mean() < 0.8 * lit["near"].mean()
    assert lit["aimed away"].max() == 0.0
    left, right = halves(lit["panel"])
    assert left > 1.1 * right
    upper, lower = halves(np.swapaxes(lit["line"], 0, 1))
    assert lower > 1.1 * upper


def test_a_sky_and_a_colour(run: Callable, trained_run: Path, ball: Path, tmp_path: Path) -> None:
    """Blue from above, dim from all around; the smoke's own colour takes the blue away again."""
    sky = np.full((16, 32, 3), 0.1, np.float32)
    sky[:6, :, 2] = 2.0
    relight.write_png(tmp_path / "sky.png", sky)
    common = (ball, "--checkpoint", trained_run, *SMALL, "--background", "0,0,0", "--light", "top,0,0,0")
    sky_option = ("--environment", tmp_path / "sky.png")
    assert run("relight", *common, *sky_option, "-o", tmp_path / "sky_lit.png").status == 0
    lit = read(tmp_path / "sky_lit.png")
    assert lit[..., 2].mean() > 1.5 * lit[..., 0].mean() > 0.0
    upper, lower = halves(np.swapaxes(lit[..., 2], 0, 1))
    assert upper > lower
    for extra in ((), ("--absorption", "0.5")):
        dyed = (*common, *sky_option, "--smoke-colour", "1,1,0.2", *extra)
        assert run("relight", *dyed, "-o", tmp_path / "dyed.png").status == 0
        assert read(tmp_path / "dyed.png")[..., 2].mean() < 0.8 * lit[..., 2].mean()
        assert (extra != ()) or np.abs(read(tmp_path / "dyed.png")[..., 0] - lit[..., 0]).max() <= 1.0


def test_run_folder_and_onnx_file_paint_the_same(
    run: Callable, trained_run: Path, onnx_file: Path, tmp_path: Path
) -> None:
    for name, checkpoint in (("run", trained_run), ("onnx", onnx_file)):
        arguments = (
            JET,
            "--checkpoint",
            checkpoint,
            "--light",
            "top",
            "--camera-yaw",
            "30",
            "-o",
            tmp_path / f"{name}.png",
        )
        assert run("relight", *arguments, *(SMALL if name == "run" else ())).status == 0
    a, b = read(tmp_path / "run.png"), read(tmp_path / "onnx.png")  # the file's own size is its default
    assert a.shape == b.shape == (28, 32, 3)
    assert np.abs(a - b).max() <= 1.0


def test_a_folder_resumes(run: Callable, trained_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    write = relight.write_png
    monkeypatch.setattr(relight, "write_png", lambda path, picture: (made.append(path.name), write(path, picture)))
    out = tmp_path / "turn"
    command = (
        "relight",
        JET,
        "--checkpoint",
        trained_run,
        *SMALL,
        "--camera-yaw",
        "0:90",
        "--pictures",
        "4",
        "-o",
        out,
    )
    names = [f"picture_{number:04d}.png" for number in range(4)]
    assert run(*command).status == 0
    assert made == names
    assert listed(out) == [*names, "relight.json"]
    first = {name: (out / name).read_bytes() for name in names}
    assert len(set(first.values())) == 4

    made.clear()
    assert run(*command).status == 0
    assert made == []

    (out / names[2]).unlink()
    assert run(*command).status == 0
    assert made == [names[2]]
    assert {name: (out / name).read_bytes() for name in names} == first

    made.clear()
    refused = run(*command, "--light", "left")
    assert refused.status == 2 and made == []
    assert "options.light: nothing there, ['left'] here" in refused.err and "--replace" in refused.err
    assert {name: (out / name).read_bytes() for name in names} == first
    assert run(*command, "--light", "left", "--replace").status == 0
    assert made == names  # another command makes all of them
    assert (out / names[0]).read_bytes() != first[names[0]]

    made.clear()
    assert run(*command[:-3], "2", "-o", out, "--replace").status == 0
    assert listed(out) == [*names[:2], "relight.json"]  # nothing of the longer path is left


def test_a_changed_volume_is_lit_anew(run: Callable, trained_run: Path, three_volumes: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ("relight", three_volumes, "--checkpoint", trained_run, *SMALL, "-o", out)
    assert run(*command).status == 0
    before = (out / "picture_0001.png").read_bytes()
    os.replace(three_volumes / "smoke_2.npz", three_volumes / "smoke_1.npz")
    (three_volumes / "smoke_2.npz").write_bytes((three_volumes / "smoke_1.npz").read_bytes())
    refused = run(*command)
    assert refused.status == 2 and "files.smoke_1.npz" in refused.err
    assert (out / "picture_0001.png").read_bytes() == before
    assert run(*command, "--replace").status == 0
    assert (out / "picture_0001.png").read_bytes() != before


def test_a_killed_command_is_not_taken_for_another(
    run: Callable, trained_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lit from the right; then from the left, killed before the first picture; then from the left again."""
    out = tmp_path / "out"
    command = ("relight", JET, "--checkpoint", trained_run, *SMALL, "--camera-yaw", "0:9", "--pictures", "2", "-o", out)
    assert run(*command, "--light", "right").status == 0
    from_right = (out / "picture_0001.png").read_bytes()
    with monkeypatch.context() as patch:

        def killed(*arguments: object) -> None:
            raise KeyboardInterrupt

        patch.setattr(relight, "write_png", killed)
        with pytest.raises(KeyboardInterrupt):
            run(*command, "--light", "left", "--replace")
    assert run(*command, "--light", "left").status == 0
    assert (out / "picture_0001.png").read_bytes() != from_right


def test_a_path_becomes_a_video(run: Callable, trained_run: Path, ball: Path, tmp_path: Path) -> None:
    """The light turns from the right over the back to the left."""
    path = tmp_path / "turn.mp4"
    lights = ("--light", "right", "--turn-lights", "0:180", "--background", "0,0,0")
    done = run(
        *("relight", ball, "--checkpoint", trained_run, "--size", "64", *lights),
        *("--pictures", "6", "--fps", "12", "-o", path),
    )
    assert done.status == 0
    frames = imageio_ffmpeg.read_frames(str(path))
    about = next(frames)
    pictures = [np.frombuffer(frame, np.uint8).reshape(64, 64, 3).astype(float) for frame in frames]
    assert about["size"] == (64, 64) and about["fps"] == 12
    assert len(pictures) == 6
    assert halves(pictures[0])[1] > halves(pictures[0])[0]
    assert halves(pictures[5])[1] < halves(pictures[5])[0]
    assert listed(tmp_path) == ["turn.mp4"]


def test_frames_chooses_among_sorted_volumes(
    run: Callable, trained_run: Path, three_volumes: Path, tmp_path: Path
) -> None:
    pattern = f"{three_volumes}/smoke_*.npz"
    common = ("--checkpoint", trained_run, *SMALL, "--density-scale", "30")
    assert run("relight", pattern, *common, "-o", tmp_path / "all").status == 0
    assert run("relight", three_volumes, *common, "--frames", "1:3", "-o", tmp_path / "some").status == 0
    assert run("relight", three_volumes / "smoke_2.npz", *common, "-o", tmp_path / "last.png").status == 0
    every = [tmp_path / f"all/picture_000{number}.png" for number in range(3)]
    some = [tmp_path / f"some/picture_000{number}.png" for number in range(2)]
    assert listed(tmp_path / "some") == ["picture_0000.png", "picture_0001.png", "relight.json"]
    assert [path.read_bytes() for path in some] == [path.read_bytes() for path in every[1:]]
    assert (tmp_path / "last.png").read_bytes() == every[2].read_bytes()
    assert len({path.read_bytes() for path in every}) == 3


@pytest.mark.parametrize(("name", "up"), [("shadeops_teapot_cloud.nvdb", "y"), ("mitsuba_tutorial_volume.vol", "z")])
def test_volumes_of_other_people(
    run: Callable, real_volumes: Path, trained_run: Path, tmp_path: Path, name: str, up: str
) -> None:
    path = tmp_path / "real.png"
    arguments = (
        "--up",
        up,
        "--camera-yaw",
        "30",
        "--size",
        "64",
        "--background",
        "0,0,0",
        "--light",
        "right",
        "-o",
        path,
    )
    done = run("relight", real_volumes / name, "--checkpoint", trained_run, *arguments)
    assert done.status == 0, done.err
    assert re.search(r"density scale [0-9.e+-]+ 1/m", done.out)
    picture = read(path)
    assert picture.shape == (64, 64, 3)
    assert (picture.max(axis=-1) > 40.0).mean() > 0.05  # there is smoke
    assert picture[0].max() < 40.0  # and a border without
    assert picture.std() > 10.0


def test_dry_run_writes_nothing(run: Callable, trained_run: Path, tmp_path: Path) -> None:
    for name in ("out.png", "out.mp4", "folder"):
        done = run("relight", JET, "--checkpoint", trained_run, "-o", tmp_path / name, "--dry-run")
        assert done.status == 0
        assert "dry run: nothing was written" in done.out and "density scale" in done.out
    assert listed(tmp_path) == []


BAD: dict[str, tuple[list[str], str]] = {
    "light that is no name": (["--light", "rihgt"], r"light 'rihgt' is not NAME.*names: right, left, top"),
    "light of zero length": (["--light", "0:0:0"], "points nowhere"),
    "light with two colours": (["--light", "right,1,1"], "is not NAME"),
    "light of no kind": (["--light", "torch@0:0:0"], "no kind of light is called 'torch'; known: point"),
    "lamp without a place": (["--light", "spot@0:0:1"], r"a spot takes 2 point\(s\)"),
    "sky that is not there": (["--environment", "sky.exr"], r"sky\.exr: there is no such picture"),
    "smoke colour of two": (["--smoke-colour", "1,1"], "--smoke-colour '1,1' is not R,G,B"),
    "absorption beyond 1": (["--absorption", "2"], r"--absorption 2.0 must lie in \[0, 1\]"),
    "negative light": (["--light", "right,1,-1,1"], "must be finite and not negative"),
    "size of zero": (["--size", "0"], "size '0' is not N or WxH"),
    "size of three": (["--size", "1x2x3"], "size '1x2x3' is not N or WxH"),
    "huge size": (["--size", "100000"], "1 to 8192 px"),
    "frames without colon": (["--frames", "1"], r"--frames '1' is not A:B"),
    "frames beyond the end": (["--frames", "0:2"], r"--frames '0:2' is not A:B with 0 <= A < B <= 1"),
    "frames backwards": (["--frames", "1:0"], "--frames '1:0' is not A:B"),
    "one png for a path": (["--camera-yaw", "0:90"], r"48 pictures need a folder or a \.mp4, not one \.png"),
    "yaw that is no number": (["--camera-yaw", "left"], "'left' is neither a number nor a path A:B"),
    "pitch over the pole": (["--camera-pitch", "95"], "camera pitch 95.0 deg must lie strictly between -90 and 90"),
    "pitch that ends over the pole": (["--camera-pitch", "0:95", "-o", "x.mp4"], "camera pitch 95.0 deg"),
    "negative margin": (["--margin", "-1"], "--margin -1.0 must be positive"),
    "margin that is no number": (["--margin", "nan"], "--margin nan must be positive"),
    "zero density scale": (["--density-scale", "0"], "--density-scale 0.0 must be positive"),
    "negative exposure": (["--exposure", "-2"], "--exposure -2.0 must be positive"),
    "zero fps": (["--fps", "0"], "--fps 0 must be positive"),
    "no pictures": (["--pictures", "0"], "--pictures 0 must be at least 1"),
    "background of two": (["--background", "1,2"], "--background '1,2' is not R,G,B"),
    "background of words": (["--background", "a,b,c"], "--background 'a,b,c' is not R,G,B"),
    "background that is no number": (["--background", "nan,0,0"], "--background 'nan,0,0' must be finite"),
    "unknown kind of output": (["-o", "out.jpg"], r"cannot write '\.jpg'; name a \.png, a \.mp4 or a folder"),
    "video of one pixel": (["--size", "1", "-o", "out.mp4"], "a video needs sides of at least 2 px"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused_by_name(refused: Callable, case: str) -> None:
    refused(*BAD[case])


def test_bad_files_are_refused_by_name(
    run: Callable, trained_run: Path, onnx_file: Path, ball: Path, three_volumes: Path, tmp_path: Path
) -> None:
    out = ("-o", tmp_path / "out.png")
    (tmp_path / "cloud.vdbx").write_text("x")
    told = run("relight", tmp_path / "cloud.vdbx", "--checkpoint", trained_run, *out).error
    assert re.search(r"cloud\.vdbx: cannot read '\.vdbx'; known:", told)
    told = run("relight", tmp_path / "none*.npz", "--checkpoint", trained_run, *out).error
    assert "no volume matches" in told
    told = run("relight", ball, "--checkpoint", tmp_path, *out).error
    assert "holds no trained net" in told and "python -m sixway.train" in told
    told = run("relight", ball, "--checkpoint", tmp_path / "none.onnx", *out).error
    assert "there is no such ONNX file" in told and "python -m sixway.export" in told
    (tmp_path / "theirs.onnx").write_bytes(b"not ours")
    told = run("relight", ball, "--checkpoint", tmp_path / "theirs.onnx", *out).error
    assert "theirs.onnx: not a readable ONNX file" in told
    told = run("relight", ball, "--checkpoint", onnx_file, "--size", "64", *out).error
    assert "runs at 32 x 28 px only, asked for 64 x 64" in told
    told = run("relight", three_volumes, "--checkpoint", trained_run, *out).error
    assert "3 pictures need a folder or a .mp4" in told
    told = run("relight", three_volumes, "--checkpoint", trained_run, "--pictures", "9", "-o", tmp_path / "new").error
    assert "--pictures 9: 3 volumes make one picture each" in told
    np.savez(tmp_path / "empty.npz", density=np.zeros((4, 4, 4), np.float32))
    told = run("relight", tmp_path / "empty.npz", "--checkpoint", trained_run, *out).error
    assert "holds no smoke" in told
    assert not (tmp_path / "out.png").exists() and not (tmp_path / "new").exists()


def test_what_is_missing_from_the_command_line_is_told(run: Callable, ball: Path) -> None:
    done = run("relight", ball)
    assert done.status == 2
    assert "--checkpoint" in done.err and "-o/--output" in done.err
