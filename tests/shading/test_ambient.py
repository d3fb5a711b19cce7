"""Light from all around: what must come out when the sky is known."""

import math

import numpy as np
import pytest

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.frames import Camera, Grid
from sixway.core.records import SixWayLightmap
from sixway.shading.ambient import Ambient, environment_directions, sh_of_environment
from sixway.shading.blend import blend_weights
from sixway.shading.compose import shade

GRID = Grid.centred((8, 8, 8))
FRONT = Camera.around(GRID).basis
HALF = 0.5**0.5


def test_directions_of_a_lat_long_picture() -> None:
    towards, solid_angle = environment_directions(90, 180)
    assert solid_angle.sum() == pytest.approx(4.0 * math.pi)
    np.testing.assert_allclose(np.linalg.norm(towards, axis=-1), 1.0)
    np.testing.assert_allclose(towards[0].mean(axis=0), [0, 1, 0], atol=0.02)
    np.testing.assert_allclose(towards[44:46, 89:91].mean((0, 1)), [0, 0, -1], atol=0.02)  # the middle: straight ahead
    np.testing.assert_allclose(towards[44:46, 134:136].mean((0, 1)), [1, 0, 0], atol=0.02)  # right of it


@pytest.mark.parametrize(("rule", "share"), [("squared", 4 / 6), ("paper_abs", 1.0), ("smoothstep", 1.0)])
def test_a_sky_alike_everywhere_spends_all_of_its_light(rule, share) -> None:
    """1/pi of the integral of the weight over the sphere, by hand; 4 pi in all for `squared`."""
    sky = np.full((64, 128, 3), (0.5, 1.0, 2.0), np.float32)
    ambient = Ambient.from_environment(sky, FRONT, rule=rule)
    np.testing.assert_allclose(ambient.per_direction, np.tile(np.array([0.5, 1.0, 2.0]) * share, (6, 1)), rtol=1e-3)


def test_the_engines_rule_is_exact_for_a_sky_alike_everywhere() -> None:
    sky = np.full((64, 128, 3), 0.3, np.float32)
    mean, slope = sh_of_environment(sky, FRONT)
    by_sh, by_picture = Ambient.from_sh(mean, slope), Ambient.from_environment(sky, FRONT)
    np.testing.assert_allclose(by_sh.per_direction, by_picture.per_direction, rtol=1e-3)
    np.testing.assert_allclose(by_sh.per_direction, 0.3 * 4 / 6, rtol=1e-3)


def test_the_engines_rule_for_a_slope() -> None:
    """mean + slope . axis for each map, 4 pi shared by six of M / pi."""
    slope = np.zeros((3, 3))
    slope[1] = (0.1, 0.2, 0.4)
    rows = dict(zip(DIRECTIONS, Ambient.from_sh(np.ones(3), slope).per_direction, strict=True))
    np.testing.assert_allclose(rows["top"], 4 / 6 * np.array([1.1, 1.2, 1.4]))
    np.testing.assert_allclose(rows["bottom"], 4 / 6 * np.array([0.9, 0.8, 0.6]))
    np.testing.assert_allclose(rows["front"], 4 / 6)


def test_a_linear_sky_is_found_and_the_engine_over_weighs_its_slope_by_a_third() -> None:
    """The exact weight of the slope is 3/4: the mean cosine under w^2. An engine takes 1."""
    towards, _ = environment_directions(128, 256)
    sky = (1.0 + 0.5 * towards[..., :1] * np.ones(3)).astype(np.float32)
    mean, slope = sh_of_environment(sky, FRONT)
    np.testing.assert_allclose(mean, 1.0, rtol=1e-3)
    np.testing.assert_allclose(slope, [[0.5] * 3, [0.0] * 3, [0.0] * 3], atol=1e-3)
    exact = Ambient.from_environment(sky, FRONT).per_direction[0, 0]
    assert exact == pytest.approx(4 / 6 * (1.0 + 0.75 * 0.5), rel=1e-3)
    assert Ambient.from_sh(mean, slope).per_direction[0, 0] == pytest.approx(4 / 6 * 1.5, rel=1e-3)


@pytest.mark.parametrize("yaw", [0.0, 60.0])
def test_a_small_sun_in_the_picture_is_a_sun(yaw: float) -> None:
    camera = Camera.around(GRID, yaw_deg=yaw, pitch_deg=20.0)
    towards, solid_angle = environment_directions(256, 512)
    sun = np.array([HALF, HALF, 0.0])
    spot = (towards @ sun) > 0.999
    sky = np.where(spot[..., None], 1.0, 0.0).astype(np.float32) * np.ones(3, np.float32)
    irradiance = (spot * solid_angle).sum()
    expected = blend_weights(camera.basis @ sun, "squared") * irradiance / math.pi
    np.testing.assert_allclose(Ambient.from_environment(sky, camera.basis).per_direction[:, 0], expected, atol=2e-6)


def test_shading_adds_each_map_in_its_sky_colour(rng) -> None:
    image = rng.random((4, 5, 7), dtype=np.float32)
    maps = SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=image)
    sky = rng.random((6, 3))
    shown = shade(maps, [], ambient=Ambient(per_direction=sky))
    np.testing.assert_allclose(shown, image[..., :6] @ sky, rtol=1e-5)


def test_impossible_skies_are_refused() -> None:
    with pytest.raises(ValueError, match="6 finite RGB"):
        Ambient(per_direction=np.full((6, 3), np.nan))
