"""Which picture shows what: paths, frames, lights that turn, and pictures that do not depend on their neighbours."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.inference.bake import LightmapBaker
from sixway.inference.predict import load_predictor
from sixway.inference.sequence import Path1D, Shot, camera_of, render
from sixway.shading.light import DirectionalLight
from sixway.volumes.npz import write_npz
from sixway.volumes.sequence import open_sequence

JET = Path(__file__).parents[1] / "data/jet.npz"
STILL = Path1D(0.0, 0.0)


@pytest.fixture(scope="module")
def baker(trained_run: Path) -> LightmapBaker:
    return LightmapBaker(load_predictor(trained_run, device="cpu"), extinction_per_m=30.0, device="cpu")


@pytest.fixture
def shot() -> Shot:
    return Shot(
        sequence=open_sequence([JET]),
        num_pictures=1,
        yaw_deg=STILL,
        pitch_deg=STILL,
        light_turn_deg=STILL,
        lights=(DirectionalLight.parse("right"),),
        rule="squared",
        exposure=1.0,
        background=(0.0, 0.0, 0.0),
        width_px=24,
        height_px=20,
        margin=1.0,
    )


def pictures(shot: Shot, baker: LightmapBaker, *numbers: int) -> list[np.ndarray]:
    made = list(render(shot, baker, list(numbers)))
    assert [number for number, _ in made] == list(numbers)
    return [picture for _, picture in made]


@pytest.mark.parametrize(
    ("text", "path"),
    [("30", (30.0, 30.0)), ("0:90", (0.0, 90.0)), ("-45:-10.5", (-45.0, -10.5)), ("1e1", (10.0, 10.0))],
)
def test_paths_parse(text: str, path: tuple[float, float]) -> None:
    assert Path1D.parse(text) == Path1D(*path)
    assert Path1D.parse(text).moves == (path[0] != path[1])


@pytest.mark.parametrize("text", ["", "a", "1:", ":1", "1:2:3", "nan", "0:inf", "1,2", "1-2"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="neither a number nor a path A:B"):
        Path1D.parse(text)


def test_a_path_has_both_its_ends_and_even_steps() -> None:
    path = Path1D(10.0, -20.0)
    assert [path.at(i, 4) for i in range(4)] == pytest.approx([10.0, 0.0, -10.0, -20.0])
    assert path.at(0, 1) == 10.0


def test_the_camera_follows_its_path(shot: Shot) -> None:
    shot = replace(shot, num_pictures=3, yaw_deg=Path1D(0.0, 90.0), pitch_deg=Path1D(0.0, 30.0))
    first, middle, last = (camera_of(shot, number).to_viewer for number in range(3))
    np.testing.assert_allclose(first, (0.0, 0.0, 1.0), atol=1e-9)
    np.testing.assert_allclose(last, (np.cos(np.pi / 6), 0.5, 0.0), atol=1e-9)
    assert middle[0] == pytest.approx(middle[2])
    assert middle[1] == pytest.approx(np.sin(np.radians(15.0)))


def test_the_end_of_a_path_is_the_still_picture_there(shot: Shot, baker: LightmapBaker) -> None:
    turning = replace(shot, num_pictures=3, yaw_deg=Path1D(0.0, 90.0))
    first, last = pictures(turning, baker, 0, 2)
    np.testing.assert_array_equal(first, pictures(shot, baker, 0)[0])
    np.testing.assert_array_equal(last, pictures(replace(shot, yaw_deg=Path1D(90.0, 90.0)), baker, 0)[0])
    assert np.abs(first - last).max() > 0.01


def test_a_picture_does_not_depend_on_those_before_it(shot: Shot, baker: LightmapBaker) -> None:
    turning = replace(shot, num_pictures=3, yaw_deg=Path1D(0.0, 90.0))
    np.testing.assert_array_equal(pictures(turning, baker, 0, 1, 2)[2], pictures(turning, baker, 2)[0])


def test_lights_turn_from_the_right_to_the_back_to_the_left(shot: Shot, baker: LightmapBaker) -> None:
    turning = replace(shot, num_pictures=3, light_turn_deg=Path1D(0.0, 180.0))
    for picture, name in zip(pictures(turning, baker, 0, 1, 2), ("right", "back", "left"), strict=True):
        lit = replace(shot, lights=(DirectionalLight.parse(name),))
        np.testing.assert_allclose(picture, pictures(lit, baker, 0)[0], atol=1e-6)


def test_exposure_scales_the_light_and_not_the_background(shot: Shot, baker: LightmapBaker) -> None:
    (once,) = pictures(shot, baker, 0)
    (twice,) = pictures(replace(shot, exposure=2.0), baker, 0)
    np.testing.assert_allclose(twice, 2.0 * once, rtol=1e-5)
    background = (0.2, 0.4, 0.6)
    (before_sky,) = pictures(replace(shot, background=background, exposure=2.0), baker, 0)
    behind = before_sky - twice
    np.testing.assert_allclose(behind[0, 0], background, atol=0.02)  # no smoke in the corner
    assert behind.min() > -1e-6
    assert behind[10, 12, 2] < 0.3  # the jet hides the sky


def test_a_sequence_takes_one_volume_a_picture(shot: Shot, baker: LightmapBaker, tmp_path: Path) -> None:
    volumes = []
    for number in range(3):
        density = np.zeros((12, 12, 12), np.float32)
        density[4:8, 4:8, 1 + 3 * number : 4 + 3 * number] = 1.0  # wanders to the right
        volumes.append(tmp_path / f"smoke_{number}.npz")
        write_npz(volumes[-1], DensityFrame(density=density, grid=Grid.centred(density.shape)))
    front = (DirectionalLight.parse("front"),)
    wandering = replace(shot, sequence=open_sequence(volumes), num_pictures=3, lights=front)
    columns = np.arange(24)
    centres = [
        float(picture.mean(axis=(0, 2)) @ columns / picture.mean(axis=(0, 2)).sum())
        for picture in pictures(wandering, baker, 0, 1, 2)
    ]
    assert centres[0] + 1.0 < centres[1] < centres[2] - 1.0
