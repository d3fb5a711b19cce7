"""`python -m sixway.relight` among solids, and with curves on the maps."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

BACKGROUND = 94.0
"""sRGB of the background's 0.11."""


@pytest.fixture
def lit(run: Callable, trained_run: Path, ball: Path, tmp_path: Path) -> Callable[..., np.ndarray]:
    """The round puff in light from the right, 32 x 28 px, with some options: the picture in sRGB."""

    def picture(*options: str) -> np.ndarray:
        path = tmp_path / "out.png"
        common = ("--checkpoint", trained_run, "--size", "32x28", "--background", "0.11,0.11,0.11", "-o", path)
        done = run("relight", ball, *common, *options)
        assert done.status == 0, done.err
        with Image.open(path) as image:
            return np.asarray(image).astype(float)

    return picture


@pytest.mark.parametrize("how", [(), ("--shadows", "shell"), ("--shadow-softness", "0.2")])
def test_a_solid_out_of_sight_casts_its_shadow(lit: Callable[..., np.ndarray], how: tuple[str, ...]) -> None:
    """Between the light and the puff it takes its light, on the other side nothing."""
    free = lit()
    shadowed = lit("--solid", "sphere@1.6:0:0,radius=0.5", *how)
    assert free[8:20, 18:26].mean() > shadowed[8:20, 18:26].mean() + 15.0
    assert np.abs(lit("--solid", "sphere@-1.6:0:0,radius=0.5", *how) - free).max() <= 1.0


def test_a_solid_hides_what_is_behind_it(lit: Callable[..., np.ndarray]) -> None:
    red = ("--solid-colour", "1,0,0", "--solid")
    free = lit()
    before, inside, behind = (lit(*red, f"sphere@0:0:{z},radius=0.15") for z in (1.0, 0.0, -1.0))
    np.testing.assert_allclose(before[14, 16], (255.0, 0.0, 0.0))
    assert behind[14, 16, 0] < inside[14, 16, 0] < 255.0  # more and more of the puff is before it
    np.testing.assert_allclose(behind[2], free[2], atol=1.0)
    thin = lit(*red, "sphere@0:0:0,radius=0.15", "--soft-particles", "2")
    assert thin[14, 16, 0] > inside[14, 16, 0]  # a particle that thick has hardly begun


def test_a_mesh_counts_as_its_file_stands(lit: Callable[..., np.ndarray], tmp_path: Path) -> None:
    """An octahedron before the puff, put there by its file (in metres) and by the command (in radii)."""
    path = tmp_path / "octahedron.obj"
    corners = "v 0.2 0 0.8\nv -0.2 0 0.8\nv 0 0.2 0.8\nv 0 -0.2 0.8\nv 0 0 1\nv 0 0 0.6\n"
    path.write_text(corners + "f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n")
    radius = 0.5 * np.sqrt(3.0)  # the puff's box is centred and 1 m wide
    by_file = lit("--solid", f"mesh@{path}")
    by_hand = lit("--solid", f"mesh@{path}@0:0:{0.8 / radius},size={0.4 / radius}")
    np.testing.assert_allclose(by_hand, by_file, atol=1.0)
    assert by_file[14, 16].max() == 0.0 and by_file[2, 16].max() > 0.0


def test_another_mesh_under_the_same_name_makes_pictures_anew(
    run: Callable, trained_run: Path, ball: Path, tmp_path: Path
) -> None:
    path, out = tmp_path / "body.obj", tmp_path / "out"
    command = ("relight", ball, "--checkpoint", trained_run, "--size", "16", "--solid", f"mesh@{path}", "-o", out)
    tetrahedron = "v {0} 0 0.6\nv 0 {0} 0.6\nv 0 0 0.6\nv 0 0 0.7\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    pictures = []
    for size, replace in ((0.2, []), (0.4567, ["--replace"])):
        path.write_text(tetrahedron.format(size))
        if replace:
            refused = run(*command)
            assert refused.status == 2 and "files.body.obj" in refused.err
        assert run(*command, *replace).status == 0
        pictures.append((out / "picture_0000.png").read_bytes())
    assert pictures[0] != pictures[1]


def test_curves_change_maps_and_alpha(lit: Callable[..., np.ndarray]) -> None:
    free = lit()
    middle = np.s_[12:16, 14:18]
    cut_off = lit("--map-range", "0:1")
    assert (cut_off <= free + 1.0).all() and np.abs(lit("--map-contrast", "0") - cut_off).max() <= 1.0
    assert np.abs(lit("--map-curve", "0:0,99:99", "--map-to", "0:1") - free)[middle].max() <= 1.0
    assert lit("--map-to", "0:0")[middle].max() < 0.6 * BACKGROUND  # black smoke
    assert lit("--map-to", "0:2")[middle].mean() > free[middle].mean() + 10.0
    np.testing.assert_allclose(lit("--alpha-curve", "0:0,1:0"), BACKGROUND, atol=1.0)
    spread = [np.ptp(lit("--map-contrast", text)[8:20, 8:24]) for text in ("-1", "1")]
    assert spread[0] < spread[1]


BAD: dict[str, tuple[list[str], str]] = {
    "no solid": (["--solid", "cone@0:0:0"], "solid 'cone@0:0:0' is none of sphere@"),
    "no mesh": (["--solid", "mesh@none.ply"], "there is no such mesh file"),
    "solid without a size": (["--solid", "box@0:0:0"], "needs size="),
    "lamp in the smoke": (["--solid", "sphere@2:0:0,radius=1", "--light", "point@0.5:0:0"], "move the lamp away"),
    "negative softness": (["--solid", "sphere@2:0:0,radius=1", "--shadow-softness", "-1"], "--shadow-softness -1.0"),
    "no fade": (["--solid", "sphere@2:0:0,radius=1", "--soft-particles", "0"], "--soft-particles 0.0 must be pos"),
    "fade without a solid": (["--soft-particles", "0.1"], "about solids; name one with --solid"),
    "solid colour": (["--solid", "sphere@2:0:0,radius=1", "--solid-colour", "1"], "--solid-colour '1' is not R,G,B"),
    "range that falls": (["--map-range", "1:0"], "--map-range 1:0: .*must rise"),
    "two shapes": (["--map-contrast", "1", "--map-curve", "0:0,1:1"], "one shape at a time"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused_by_name(refused: Callable, case: str) -> None:
    refused(*BAD[case])
