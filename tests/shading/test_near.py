"""Lamps against closed forms and against sums over many small lamps."""

import math

import numpy as np
import pytest

from sixway.shading.light import DirectionalLight, LineLight, PointLight, RectangleLight, SpotLight
from sixway.shading.near import arriving, middle_of, nearest_point

WHITE, ORIGIN = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
POINTS = np.array([[0.0, 0.0, 0.0], [0.5, -0.3, 0.8], [-1.2, 0.4, 0.3], [0.1, 1.4, -0.2]])


def summed(samples_m: np.ndarray, strengths: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean direction and irradiance of many point lamps of those intensities."""
    offset = samples_m[None] - points[:, None]
    distance = np.linalg.norm(offset, axis=-1)
    share = strengths / distance**2
    vector = (share[..., None] * offset / distance[..., None]).sum(axis=1)
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True), share.sum(axis=1)


def test_a_lamp_falls_with_the_square_of_its_distance() -> None:
    lamp = PointLight(position_m=(0.0, 2.0, 0.0), intensity=(3.0, 2.0, 1.0))
    to_light, irradiance = arriving(lamp, np.array([[0.0, 0.0, 0.0], [0.0, 1.5, 0.0], [3.0, 2.0, 0.0]]))
    np.testing.assert_allclose(irradiance, np.outer([1 / 4, 4.0, 1 / 9], [3.0, 2.0, 1.0]))
    np.testing.assert_allclose(to_light, [[0, 1, 0], [0, 1, 0], [-1, 0, 0]], atol=1e-12)


def test_at_the_lamp_itself_light_is_finite() -> None:
    lamp = PointLight(position_m=(0.0, 0.0, 0.0), intensity=WHITE, radius_m=0.1)
    to_light, irradiance = arriving(lamp, np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.2, 0.0, 0.0]]))
    np.testing.assert_allclose(irradiance[:, 0], [100.0, 100.0, 25.0])
    np.testing.assert_allclose(np.linalg.norm(to_light, axis=-1), 1.0)


def test_range_ends_a_light_smoothly() -> None:
    near, far = (PointLight(position_m=(0.0, 0.0, 0.0), intensity=WHITE, range_m=r) for r in (2.0, math.inf))
    places = np.array([[0.1, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    share = arriving(near, places)[1][:, 0] / arriving(far, places)[1][:, 0]
    np.testing.assert_allclose(share, [1.0, (1 - 1 / 16) ** 2, 0.0, 0.0], atol=2e-5)


def test_a_spot_is_full_in_its_beam_and_falls_to_its_edge() -> None:
    spot = SpotLight(position_m=ORIGIN, towards=(0.0, 0.0, 1.0), intensity=WHITE, cutoff_deg=30.0, beam_deg=20.0)
    angles = np.radians([0.0, 19.9, 25.0, 30.1, 180.0])
    places = 2.0 * np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)], axis=-1)
    np.testing.assert_allclose(4.0 * arriving(spot, places)[1][:, 1], [1.0, 1.0, 0.5, 0.0, 0.0], atol=1e-9)


def test_a_wire_is_the_sum_of_its_lamps() -> None:
    line = LineLight(start_m=(-0.7, 0.9, -1.0), end_m=(0.6, 1.1, -0.5), intensity=WHITE)
    share = (np.arange(20000) + 0.5)[:, None] / 20000
    samples = np.array(line.start_m) * (1 - share) + np.array(line.end_m) * share
    to_light, irradiance = arriving(line, POINTS)
    mean, strength = summed(samples, np.full(20000, 1 / 20000), POINTS)
    np.testing.assert_allclose(irradiance[:, 0], strength, rtol=1e-6)
    np.testing.assert_allclose(to_light, mean, atol=1e-6)


def test_a_wire_seen_end_on_is_neither_lost_nor_infinite() -> None:
    line = LineLight(start_m=(1.0, 0.0, 0.0), end_m=(2.0, 0.0, 0.0), intensity=WHITE)
    to_light, irradiance = arriving(line, np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]]))
    assert irradiance[0, 0] == pytest.approx(1.0 - 0.5, rel=1e-3)  # int_1^2 ds / s^2
    np.testing.assert_allclose(to_light[0], [1.0, 0.0, 0.0], atol=1e-9)
    assert np.isfinite(irradiance).all() and irradiance[1, 0] > 100.0


def test_a_panel_is_the_sum_of_its_lamps() -> None:
    centre, right, up = (0.2, 0.1, -2.0), (0.8, 0.0, 0.0), (0.0, 0.5, 0.0)
    panel = RectangleLight(centre_m=centre, half_right_m=right, half_up_m=up, radiance=WHITE)
    side = (np.arange(400) + 0.5) / 200 - 1.0
    x, y = (part.ravel() for part in np.meshgrid(side, side))
    samples = np.array(panel.centre_m) + np.stack([0.8 * x, 0.5 * y, 0.0 * x], axis=-1)
    points = POINTS * (1, 1, 0.5)
    offset = samples[None] - points[:, None]
    cosine = -offset[..., 2] / np.linalg.norm(offset, axis=-1)  # shines towards +z; Lambert's law
    mean, strength = summed(samples, cosine * (4 * 0.8 * 0.5 / len(samples)), points)
    to_light, irradiance = arriving(panel, points)
    np.testing.assert_allclose(irradiance[:, 0], strength, rtol=1e-4)
    np.testing.assert_allclose(to_light, mean, atol=1e-4)


def test_a_panel_is_dark_behind_and_half_the_sky_close_by() -> None:
    panel = RectangleLight(centre_m=ORIGIN, half_right_m=(1.0, 0.0, 0.0), half_up_m=(0.0, 1.0, 0.0), radiance=WHITE)
    to_light, irradiance = arriving(panel, np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 1e-6], [0.0, 0.0, 1.0]]))
    assert irradiance[0, 0] == 0.0
    assert irradiance[1, 0] == pytest.approx(2.0 * math.pi, rel=1e-4)
    assert irradiance[2, 0] == pytest.approx(4.0 * math.asin(1.0 / 2.0), rel=1e-9)  # side 2 seen from distance 1
    np.testing.assert_allclose(to_light[1:], [[0, 0, -1], [0, 0, -1]], atol=1e-9)


def test_the_nearest_part_of_a_light_lies_on_it() -> None:
    line = LineLight(start_m=(-1.0, 0.5, 0.0), end_m=(1.0, 0.5, 0.0), intensity=WHITE)
    places = np.array([[0.3, 2.0, 1.0], [5.0, 0.0, 0.0]])
    np.testing.assert_allclose(nearest_point(line, places), [[0.3, 0.5, 0.0], [1.0, 0.5, 0.0]], atol=1e-12)
    panel = RectangleLight(
        centre_m=(0.0, 0.5, 1.0), half_right_m=(2.0, 0.0, 0.0), half_up_m=(0.0, 0.5, 0.0), radiance=WHITE
    )
    np.testing.assert_allclose(nearest_point(panel, places), [[0.3, 1.0, 1.0], [2.0, 0.0, 1.0]], atol=1e-12)
    lamp = PointLight(position_m=(0.1, 0.2, 0.3), intensity=WHITE)
    np.testing.assert_allclose(nearest_point(lamp, places), [[0.1, 0.2, 0.3]] * 2)
    middles = [middle_of(light) for light in (line, panel, lamp)]
    np.testing.assert_allclose(middles, [[0.0, 0.5, 0.0], [0.0, 0.5, 1.0], [0.1, 0.2, 0.3]])


@pytest.mark.parametrize("kind", ["point", "spot", "line", "rectangle"])
def test_far_away_every_light_is_a_sun(kind) -> None:
    far = 1000.0
    light = {
        "point": PointLight(position_m=(0.0, 0.0, far), intensity=(far**2,) * 3),
        "spot": SpotLight(position_m=(0.0, 0.0, far), towards=(0.0, 0.0, -1.0), intensity=(far**2,) * 3),
        "line": LineLight(start_m=(-1.0, 0.0, far), end_m=(1.0, 0.0, far), intensity=(far**2,) * 3),
        "rectangle": RectangleLight(
            centre_m=(0.0, 0.0, far),
            half_right_m=(-1.0, 0.0, 0.0),
            half_up_m=(0.0, 1.0, 0.0),
            radiance=(far**2 / 4,) * 3,
        ),
    }[kind]
    to_light, irradiance = arriving(light, POINTS)
    np.testing.assert_allclose(to_light, np.tile([0.0, 0.0, 1.0], (4, 1)), atol=3e-3)
    np.testing.assert_allclose(irradiance, 1.0, rtol=3e-3)


@pytest.mark.parametrize(
    "make",
    [
        lambda: DirectionalLight(to_light=(1.0, 1.0, 0.0)),
        lambda: DirectionalLight(to_light=(1.0, 0.0, 0.0), angle_deg=90.0),
        lambda: PointLight(position_m=(0.0, 0.0, math.nan), intensity=WHITE),
        lambda: PointLight(position_m=(0.0, 0.0, 0.0), intensity=(1.0, -1.0, 1.0)),
        lambda: PointLight(position_m=(0.0, 0.0, 0.0), intensity=WHITE, range_m=0.0),
        lambda: PointLight(position_m=(0.0, 0.0, 0.0), intensity=WHITE, radius_m=0.0),
        lambda: SpotLight(position_m=(0.0, 0.0, 0.0), towards=(0.0, 0.0, 1.0), intensity=WHITE, cutoff_deg=10.0),
        lambda: LineLight(start_m=(1.0, 0.0, 0.0), end_m=(1.0, 0.0, 0.0), intensity=WHITE),
        lambda: RectangleLight(
            centre_m=ORIGIN, half_right_m=(1.0, 0.0, 0.0), half_up_m=(1.0, 1.0, 0.0), radiance=WHITE
        ),
    ],
)
def test_impossible_lights_are_refused(make) -> None:
    with pytest.raises(ValueError, match="must be|needs|must not|length"):
        make()
