"""From depth to world and back, and lamps that shine on what stands there."""

import math

import numpy as np
import pytest

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.frames import Camera, Grid
from sixway.core.records import SixWayLightmap
from sixway.shading.compose import shade
from sixway.shading.light import DirectionalLight, PointLight
from sixway.shading.surface import SmokeSurface, project

GRID = Grid(shape_zyx=(8, 8, 8), voxel_size_m=0.125, origin_m=(0.5, -1.0, 2.0))
CAMERAS = [
    Camera.around(GRID, yaw_deg=35.0, pitch_deg=-15.0, kind=kind, width_px=12, height_px=9)
    for kind in ("perspective", "orthographic")
]


@pytest.mark.parametrize("camera", CAMERAS, ids=["perspective", "orthographic"])
def test_points_project_back_to_their_pixels_and_depths(camera: Camera, rng) -> None:
    depth = rng.uniform(0.5, 4.0, (9, 12))
    surface = SmokeSurface.from_depth(camera, depth)
    pixels, again = project(camera, surface.points_m)
    np.testing.assert_allclose(again, depth, rtol=1e-9)
    np.testing.assert_allclose(surface.depth_m, depth, rtol=1e-9)
    v, u = np.indices((9, 12)) + 0.5
    np.testing.assert_allclose(pixels, np.stack([u, v], axis=-1), atol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS, ids=["perspective", "orthographic"])
def test_where_there_is_no_smoke_the_target_plane_stands_in(camera: Camera) -> None:
    surface = SmokeSurface.from_depth(camera, np.full((9, 12), np.inf))
    offset = (surface.points_m - np.array(camera.target_m)) @ np.array(camera.to_viewer)
    np.testing.assert_allclose(offset, 0.0, atol=1e-9)


def test_depths_that_make_no_sense_are_refused() -> None:
    for bad in (np.full((9, 12), np.nan), np.full((9, 12), -1.0), np.ones((9, 9))):
        with pytest.raises(ValueError, match="depth"):
            SmokeSurface.from_depth(CAMERAS[0], bad)


def test_behind_a_pinhole_depth_is_negative() -> None:
    camera = CAMERAS[0]
    behind = np.array(camera.position_m) + np.array(camera.to_viewer)
    assert project(camera, behind[None])[1][0] == pytest.approx(-1.0)


@pytest.fixture
def lightmap(rng) -> SixWayLightmap:
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=rng.random((9, 12, 7), dtype=np.float32))


@pytest.mark.parametrize("camera", CAMERAS, ids=["perspective", "orthographic"])
def test_a_lamp_far_away_is_a_sun(lightmap: SixWayLightmap, camera: Camera) -> None:
    to_light, far = np.array([0.6, 0.0, 0.8]), 1e4
    at = np.array(GRID.centre_m) + far * (to_light @ camera.basis)
    lamp = PointLight(position_m=tuple(at.tolist()), intensity=tuple(math.pi * far**2 * c for c in (3.0, 2.0, 1.0)))
    sun = DirectionalLight(to_light=(0.6, 0.0, 0.8), colour=(3.0, 2.0, 1.0))
    surface = SmokeSurface.from_depth(camera, np.full((9, 12), 2.0))
    np.testing.assert_allclose(shade(lightmap, [lamp], surface=surface), shade(lightmap, [sun]), rtol=2e-3)


def test_a_lamp_inside_the_smoke_lights_each_side_from_its_own(lightmap: SixWayLightmap) -> None:
    """Seen from the front, a lamp in the middle lights the left half from its right, and the other way round."""
    camera = Camera.around(GRID, kind="orthographic", width_px=12, height_px=9)
    image = np.zeros((9, 12, 7), np.float32)
    right_only = SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=image.copy())
    right_only.image[..., 0] = 1.0
    surface = SmokeSurface.from_depth(camera, np.full((9, 12), np.inf))
    lamp = PointLight(position_m=GRID.centre_m, intensity=(1.0, 1.0, 1.0))
    shown = shade(right_only, [lamp], surface=surface)[..., 0]
    assert not shown[:, 6:].any() and (shown[:, :6] > 0.0).all()
    distance = np.linalg.norm(surface.points_m - np.array(GRID.centre_m), axis=-1)
    weight = ((np.array(GRID.centre_m) - surface.points_m)[..., 0] / distance) ** 2  # squared rule, seen from +z
    np.testing.assert_allclose(shown[:, :6], (weight / distance**2 / math.pi)[:, :6], rtol=1e-5)


def test_lamps_need_a_surface(lightmap: SixWayLightmap) -> None:
    with pytest.raises(ValueError, match="PointLight stands in the world"):
        shade(lightmap, [PointLight(position_m=(0.0, 0.0, 0.0), intensity=(1.0, 1.0, 1.0))])
    with pytest.raises(ValueError, match="one for each"):
        shade(lightmap, [], visible=[np.ones((9, 12))])


def test_what_obstacles_leave_multiplies_one_light_only(lightmap: SixWayLightmap, rng) -> None:
    lights = [DirectionalLight.parse("right"), DirectionalLight.parse("top,0,1,0")]
    left = rng.random((9, 12))
    shown = shade(lightmap, lights, visible=[left, np.ones((9, 12))])
    apart = left[..., None] * shade(lightmap, lights[:1]) + shade(lightmap, lights[1:])
    np.testing.assert_allclose(shown, apart, rtol=1e-5, atol=1e-6)
