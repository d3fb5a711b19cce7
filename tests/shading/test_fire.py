"""Ramps of fire: black bodies have their published colours, artists get what they wrote."""

from pathlib import Path

import numpy as np
import pytest

from sixway.core.config import Config, ConfigError, load_config
from sixway.shading.fire import ArtistRamp, BlackBodyRamp, FireRamp, _black_body_xyz, black_body_rgb, fire_colour

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize(
    ("temperature_k", "xy", "within"),
    [  # Planckian locus of the CIE 1931 observer; 2856 K is illuminant A. The fit is poorest in the far red
        (1000.0, (0.6528, 0.3445), 0.012),
        (2000.0, (0.5267, 0.4133), 0.004),
        (2856.0, (0.4476, 0.4074), 0.003),
        (6500.0, (0.3135, 0.3237), 0.002),
        (10000.0, (0.2807, 0.2884), 0.002),
    ],
)
def test_black_bodies_lie_on_the_planckian_locus(temperature_k: float, xy: tuple[float, float], within: float) -> None:
    assert _black_body_xyz(np.array([temperature_k]))[0, :2] == pytest.approx(xy, abs=within)


def test_hotter_is_less_red_and_the_white_point_is_nearly_white() -> None:
    rgb = black_body_rgb(np.array([1000.0, 1500.0, 2000.0, 3000.0, 6500.0]))
    np.testing.assert_allclose(rgb @ LUMINANCE, 1.0, rtol=1e-12)
    assert (np.diff(rgb[:, 0] / rgb[:, 1]) < 0.0).all()
    assert rgb.min() >= 0.0
    np.testing.assert_allclose(rgb[-1], 1.0, atol=0.06)


def test_a_black_body_ramp_keeps_the_luminance_of_the_map(rng: np.random.Generator) -> None:
    emissive = 3.0 * rng.random((5, 7), dtype=np.float32)
    emissive[0, 0] = 0.0
    image = fire_colour(emissive, BlackBodyRamp())
    assert image.dtype == np.float32 and image.shape == (5, 7, 3)
    np.testing.assert_allclose(image @ LUMINANCE, emissive, rtol=2e-3)  # between two of the temperatures kept
    assert not image[0, 0].any()


def test_full_moves_the_colours_of_a_black_body_and_not_its_brightness() -> None:
    value = np.full((1, 1), 2.0, np.float32)
    hot, warm = fire_colour(value, BlackBodyRamp())[0, 0], fire_colour(value, BlackBodyRamp(), full=4.0)[0, 0]
    assert warm @ LUMINANCE == pytest.approx(hot @ LUMINANCE, rel=2e-3)
    assert warm[2] / warm[0] < hot[2] / hot[0]
    half = fire_colour(value / 4.0, BlackBodyRamp())[0, 0]  # half of full 1
    np.testing.assert_allclose(warm / warm[0], half / half[0], rtol=1e-5)


def test_an_artist_ramp_passes_through_its_stops_and_grows_beyond() -> None:
    red, white = (0.5, 0.1, 0.0), (2.0, 1.5, 1.0)
    ramp = ArtistRamp(stops=((0.5, red), (1.0, white)))
    image = fire_colour(np.array([[0.0, 0.25, 0.5, 0.75, 1.0, 3.0]], np.float32), ramp)[0]
    between = (np.array(red) + white) / 2.0
    expected = [(0.0, 0.0, 0.0), np.array(red) / 2.0, red, between, white, 3.0 * np.array(white)]
    np.testing.assert_allclose(image, np.array(expected), rtol=1e-6)
    np.testing.assert_allclose(fire_colour(np.full((1, 1), 5.0), ramp, full=10.0)[0, 0], 10.0 * np.array(red))


def test_the_default_artist_ramp_goes_from_dark_red_by_orange_and_yellow_to_white() -> None:
    values = np.array([[0.05, 0.35, 0.7, 1.0]], np.float32)
    dark, orange, yellow, white = fire_colour(values, ArtistRamp())[0]
    assert dark.max() < 0.1 and dark[0] > 10.0 * dark[1]
    assert orange[0] > 3.0 * orange[1] > 9.0 * orange[2]
    assert yellow[1] > 0.5 * yellow[0] > 2.0 * yellow[2]
    assert white.min() > 0.6 * white.max() and white.min() > 1.0


class _Look(Config):
    fire: FireRamp = BlackBodyRamp()


def test_ramps_are_written_in_yaml(tmp_path: Path) -> None:
    path = tmp_path / "look.yaml"
    path.write_text("fire: {kind: artist, stops: [[0.5, [1.0, 0.2, 0.0]], [1.0, [1.0, 1.0, 0.9]]]}\n")
    assert load_config(_Look, path).fire == ArtistRamp(stops=((0.5, (1.0, 0.2, 0.0)), (1.0, (1.0, 1.0, 0.9))))
    path.write_text("fire: {kind: black_body, coldest_k: 900.0}\n")
    assert load_config(_Look, path).fire == BlackBodyRamp(coldest_k=900.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{kind: black_body, coldest_k: 4000.0}", "must lie below hottest_k"),
        ("{kind: artist, stops: []}", "must rise"),
        ("{kind: artist, stops: [[0.0, [1, 1, 1]]]}", "the first one above 0"),
        ("{kind: artist, stops: [[0.5, [1, 1, 1]], [0.5, [1, 1, 1]]]}", "must rise"),
        ("{kind: artist, stops: [[0.5, [1, -1, 1]]]}", "negative colours"),
    ],
)
def test_ramps_that_make_no_sense_are_refused(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "look.yaml").write_text(f"fire: {text}\n")
    with pytest.raises(ConfigError, match=told):
        load_config(_Look, tmp_path / "look.yaml")


def test_full_must_be_positive() -> None:
    with pytest.raises(ValueError, match="full 0"):
        fire_colour(np.ones((1, 1)), BlackBodyRamp(), full=0.0)
