"""Solids in a shot against an even slab of smoke, whose shares are closed forms."""

import numpy as np
import pytest

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.core.solids import Box, Sphere
from sixway.inference import obstacles as module
from sixway.inference.obstacles import Obstacles, share_before
from sixway.shading.light import DirectionalLight, PointLight
from sixway.shading.shadow_volume import shadowed_share
from sixway.shading.surface import SmokeSurface

CUBE = DensityFrame(density=np.ones((32, 32, 32), np.float32), grid=Grid.centred((32, 32, 32)))
"""1 m of even smoke around the origin."""
FRONT = Camera.orthographic(position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), size_m=2.0, width_px=16, height_px=16)
MEDIUM = Medium(extinction_per_m=3.0)
SURFACE = SmokeSurface.from_depth(FRONT, np.full((16, 16), 2.5))
RIGHT = DirectionalLight(to_light=(1.0, 0.0, 0.0))
LIGHTMAP = SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=np.full((16, 16, 7), 0.2, np.float32))
INSIDE = np.s_[5:11, 5:11]
"""Pixels that see the cube, its edges apart."""


def wall(z_m: float) -> Box:
    """Fills the right half of the picture; its front is at z_m."""
    return Box(centre_m=(5.0, 0.0, z_m - 0.05), size_m=(10.0, 10.0, 0.1))


@pytest.mark.parametrize(("z_m", "share"), [(1.0, 0.0), (0.25, 0.25), (0.0, 0.5), (-0.4, 0.9), (-2.0, 1.0)])
def test_the_share_before_a_wall_is_that_of_its_place(z_m: float, share: float) -> None:
    depth = np.full((16, 16), np.inf)
    depth[:, 8:] = 3.0 - z_m
    part = share_before(depth, CUBE, FRONT)
    assert (part[:, :8] == 1.0).all()
    np.testing.assert_allclose(part[5:11, 8:11], share, atol=0.01)
    assert (part[:2, 8:] == 1.0).all()  # no smoke there


def test_the_share_does_not_depend_on_what_is_behind_the_camera() -> None:
    inside = Camera.perspective(position_m=(0.0, 0.0, 0.25), target_m=(0.0, 0.0, -0.5), width_px=3, height_px=3)
    part = share_before(np.full((3, 3), 0.375), CUBE, inside)  # half of the 0.75 m before it
    assert part[1, 1] == pytest.approx(0.5, abs=0.02)


def seen(z_m: float, *, fade_m: float | None = None) -> np.ndarray:
    """Smoke of alpha 0.75 and colour 0.3 before a background of 0.5, with a red wall in its right half."""
    solids = Obstacles(solids=(wall(z_m),), colour=(1.0, 0.0, 0.0), fade_m=fade_m)
    alpha = np.zeros((16, 16), np.float32)
    alpha[INSIDE] = 0.75
    depth = np.where(alpha > 0.0, 2.5, np.inf)
    background = np.full((16, 16, 3), 0.5, np.float32)
    return solids.among(0.4 * alpha[..., None].repeat(3, axis=-1), alpha, depth, CUBE, FRONT, background)


@pytest.mark.parametrize("fade_m", [None, 1.0])  # as deep as the cube: both are the same
def test_a_wall_hides_what_is_behind_it_and_shows_through_what_is_not(fade_m: float | None) -> None:
    free = np.full(3, 0.3 + 0.25 * 0.5)
    for z_m, kept in ((1.0, 0.0), (0.0, 0.5), (-2.0, 0.75)):
        picture = seen(z_m, fade_m=fade_m)
        np.testing.assert_allclose(picture[5:11, 5:8], np.broadcast_to(free, (6, 3, 3)), atol=1e-5)
        expected = 0.4 * kept + (1.0 - kept) * np.array([1.0, 0.0, 0.0])
        np.testing.assert_allclose(picture[6:10, 8:10], np.broadcast_to(expected, (4, 2, 3)), atol=0.01)
        np.testing.assert_allclose(picture[0, 12], (1.0, 0.0, 0.0), atol=1e-6)
        np.testing.assert_allclose(picture[0, 2], 0.5, atol=1e-6)


def test_a_soft_particle_fades_over_its_own_depth() -> None:
    """The wall is 0.1 m behind the smoke's beginning: half of a particle of 0.2 m, 1 - sqrt(1 - 0.75)."""
    picture = seen(0.4, fade_m=0.2)
    np.testing.assert_allclose(picture[7, 9], 0.2 + 0.5 * np.array([1.0, 0.0, 0.0]), atol=0.01)


def test_edges_of_solids_are_smooth() -> None:
    """The ball covers no whole number of pixels: those at its rim are partly its colour."""
    ball = Obstacles(solids=(Sphere(centre_m=(0.0, 0.0, 1.5), radius_m=0.6),), colour=(1.0, 1.0, 1.0))
    black, none = np.zeros((16, 16, 3), np.float32), np.zeros((16, 16), np.float32)
    picture = ball.among(black, none, np.full((16, 16), np.inf), CUBE, FRONT, black)[..., 0]
    assert set(np.unique(picture)) > {0.0, 1.0}
    assert picture.mean() == pytest.approx(np.pi * 0.6**2 / 4.0, rel=0.03)


def test_a_small_picture_is_marched_as_it_is() -> None:
    ball = Obstacles(solids=(Sphere(centre_m=(1.0, 0.0, 0.0), radius_m=0.2),))
    left = ball.left(RIGHT, LIGHTMAP, SURFACE, CUBE, MEDIUM, rule="squared")
    whole = shadowed_share(RIGHT, ball.solids, CUBE, MEDIUM, FRONT, arrived=np.full((16, 16), 0.2))
    np.testing.assert_allclose(left, whole, atol=1e-6)
    assert left[8, 8] < 0.9 and left[5, 10] > left[8, 8]


def test_a_large_picture_is_marched_as_a_smaller_one(monkeypatch: pytest.MonkeyPatch) -> None:
    ball = Obstacles(solids=(Sphere(centre_m=(1.0, 0.0, 0.0), radius_m=0.2),))
    whole = ball.left(RIGHT, LIGHTMAP, SURFACE, CUBE, MEDIUM, rule="squared")
    monkeypatch.setattr(module, "_MARCHED_PX", 8)
    left = ball.left(RIGHT, LIGHTMAP, SURFACE, CUBE, MEDIUM, rule="squared")
    assert left.shape == (16, 16)
    assert 0.0 < np.abs(left - whole)[INSIDE].mean() < 0.1


@pytest.mark.parametrize("shadows", ["march", "shell"])
@pytest.mark.parametrize("lamp", [RIGHT, PointLight(position_m=(2.0, 0.0, 0.0), intensity=(1.0, 1.0, 1.0))])
def test_solids_shadow_the_side_that_they_stand_on(shadows, lamp) -> None:
    """A wall before the light leaves nothing, one on the other side everything."""
    for x, share in ((1.2, 0.0), (-1.2, 1.0)):
        plate = Obstacles(solids=(Box(centre_m=(x, 0.0, 0.0), size_m=(0.1, 4.0, 4.0)),), shadows=shadows)
        left = plate.left(lamp, LIGHTMAP, SURFACE, CUBE, MEDIUM, rule="squared")
        np.testing.assert_allclose(left[INSIDE], share, atol=1e-6)


def test_a_lamp_in_the_smoke_is_told_before_it_is_lit() -> None:
    ball = Obstacles(solids=(Sphere(centre_m=(1.0, 0.0, 0.0), radius_m=0.2),))
    ball.check([RIGHT], CUBE.grid, FRONT)
    with pytest.raises(ValueError, match="move the lamp away"):
        ball.check([RIGHT, PointLight(position_m=(0.3, 0.0, 0.0), intensity=(1.0, 1.0, 1.0))], CUBE.grid, FRONT)
