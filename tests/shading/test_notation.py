"""Lights as a user writes them."""

import math

import numpy as np
import pytest

from sixway.core.frames import Camera, Grid
from sixway.shading.light import DirectionalLight, Light, LineLight, PointLight, RectangleLight, SpotLight
from sixway.shading.near import arriving
from sixway.shading.notation import parse_light, parse_rgb, parse_sun
from sixway.shading.turn import turned

GRID = Grid(shape_zyx=(10, 10, 10), voxel_size_m=0.4 / math.sqrt(3.0), origin_m=(1.0, 1.0, 1.0))  # radius 2 m
CENTRE = np.array(GRID.centre_m)


@pytest.mark.parametrize(
    ("text", "to_light", "colour"),
    [
        ("right", (1, 0, 0), (1, 1, 1)),
        ("right,1,0.9,0.8", (1, 0, 0), (1, 0.9, 0.8)),
        ("0:0:2,3,3,3", (0, 0, 1), (3, 3, 3)),
        ("front,2,2,2,angle=4", (0, 0, 1), (2, 2, 2)),
    ],
)
def test_suns(text, to_light, colour) -> None:
    light = parse_light(text, GRID)
    assert isinstance(light, DirectionalLight)
    assert light == parse_sun(text) == DirectionalLight.parse(text)
    assert light.to_light == pytest.approx(to_light)
    assert light.colour == pytest.approx(colour)
    assert light.angle_deg == (4.0 if "angle" in text else 0.0)


@pytest.mark.parametrize("kind", ["point@1:0:0", "spot@1:0:0@0:0:0", "line@1:0:-0.001@1:0:0.001"])
def test_lamps_show_their_colour_one_radius_away(kind: str) -> None:
    light = parse_light(f"{kind},3,2,1", GRID)
    to_light, irradiance = arriving(light, CENTRE[None])
    np.testing.assert_allclose(irradiance[0] / math.pi, (3.0, 2.0, 1.0), rtol=1e-5)
    np.testing.assert_allclose(to_light[0], (1.0, 0.0, 0.0), atol=1e-6)


def test_lamps_in_detail() -> None:
    point = parse_light("point@0:0.5:-1,range=3", GRID)
    assert isinstance(point, PointLight)
    np.testing.assert_allclose(point.position_m, CENTRE + np.array([0.0, 1.0, -2.0]))
    assert point.range_m == pytest.approx(6.0)
    spot = parse_light("spot@0:2:0@0:0:0,1,1,1,cone=60,beam=10", GRID)
    assert isinstance(spot, SpotLight)
    assert (spot.cutoff_deg, spot.beam_deg) == (30.0, 5.0)
    np.testing.assert_allclose(spot.towards, (0.0, -1.0, 0.0))
    line = parse_light("line@-1:0:0@1:0:0", GRID)
    assert isinstance(line, LineLight)
    np.testing.assert_allclose(line.end_m, CENTRE + np.array([2.0, 0.0, 0.0]))


@pytest.mark.parametrize(("centre", "right"), [("0:0:2", (1, 0, 0)), ("0:3:0", (1, 0, 0)), ("2:0:0", (0, 0, -1))])
def test_panels_face_where_they_are_told(centre: str, right) -> None:
    panel = parse_light(f"rectangle@{centre}@0:0:0,5,5,5,size=2x0.5", GRID)
    assert isinstance(panel, RectangleLight)
    half_right, half_up = np.array(panel.half_right_m), np.array(panel.half_up_m)
    normal = np.cross(half_right, half_up)
    away = CENTRE - panel.centre_m
    np.testing.assert_allclose(normal / np.linalg.norm(normal) @ away, np.linalg.norm(away))
    assert (np.linalg.norm(half_right), np.linalg.norm(half_up)) == pytest.approx((2.0, 0.5))
    if right == (1, 0, 0):
        assert abs(half_right[0]) == pytest.approx(2.0)
    else:
        assert abs(half_right[2]) == pytest.approx(2.0)
    assert panel.radiance == (5.0, 5.0, 5.0)
    assert arriving(panel, CENTRE[None])[1][0, 0] > 0.0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("sideways", "is not NAME.*names: right, left, top"),
        ("right,1", "is not NAME"),
        ("0:0:0", "points nowhere"),
        ("1:2,1,1,1", "is not NAME"),
        ("right,a,b,c", "is not NAME"),
        ("right,-1,0,0", "not negative"),
        ("right,range=2", "a sun has no range"),
        ("lamp@0:0:0", "no kind of light is called 'lamp'; known: point, spot"),
        ("point@0:0", "is not NAME"),
        ("point@0:0:0@1:1:1", r"a point takes 1 point\(s\)"),
        ("spot@0:0:0", r"a spot takes 2 point\(s\)"),
        ("spot@0:0:0@0:0:0", "aimed at itself"),
        ("point@0:0:0,cone=3", "a point has no cone; it has range"),
        ("point@0:0:0,range=x", "range=x is no number"),
        ("point@0:0:0,range=-1", "must be positive"),
        ("spot@0:0:0@1:0:0,cone=200", "cutoff 100.0 deg"),
        ("line@0:0:0@0:0:0", "length_m"),
        ("rectangle@0:0:0@1:0:0,size=2", "size=2 is not WxH"),
        ("rectangle@0:0:0@1:0:0,size=0x1", "half_right_m"),
    ],
)
def test_lights_that_make_no_sense_are_refused(text, told) -> None:
    with pytest.raises(ValueError, match=told):
        parse_light(text, GRID)


def test_colours() -> None:
    assert parse_rgb("1, 0.5,0", name="--sky") == (1.0, 0.5, 0.0)
    for bad in ("1,2", "a,b,c", "nan,0,0", "-1,0,0"):
        with pytest.raises(ValueError, match="--sky"):
            parse_rgb(bad, name="--sky")


@pytest.mark.parametrize(
    "text", ["0.6:0:0.8", "point@0.6:0.2:0.8", "spot@0.6:0:2@0:0:0", "line@0.6:0:0.8@1:1:1", "rectangle@0.6:0:2@0:0:0"]
)
def test_turning_lights_and_smoke_alike_changes_nothing(text: str) -> None:
    """A turned light shows a point what the light itself shows the point turned back."""
    camera = Camera.around(GRID, yaw_deg=20.0, pitch_deg=30.0)
    light: Light = parse_light(text, GRID)
    if isinstance(light, DirectionalLight):
        assert turned(DirectionalLight.parse("front"), 90.0, camera).to_light == pytest.approx((1, 0, 0), abs=1e-9)
        return
    x, y, z = camera.basis
    quarter = np.outer(x, z) - np.outer(z, x) + np.outer(y, y)  # front goes to the right
    points = CENTRE + np.array([[0.1, 0.2, 0.3], [-0.4, 0.2, -0.1]])
    to_light, irradiance = arriving(light, points)
    to_light_2, irradiance_2 = arriving(turned(light, 90.0, camera), CENTRE + (points - CENTRE) @ quarter.T)
    np.testing.assert_allclose(irradiance_2, irradiance, rtol=1e-9)
    np.testing.assert_allclose(to_light_2, to_light @ quarter.T, atol=1e-9)
