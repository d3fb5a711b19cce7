"""Pictures under any light: against the six maps, against each other, and shadows where they belong."""

from dataclasses import replace

import numpy as np
import pytest

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.core.solids import Box, Cylinder, Obstacle, Sphere
from sixway.reference.lightmaps import trace_lightmaps
from sixway.reference.lights import ConstantEnvironment, DirectionalLight, PointLight, SpotLight
from sixway.reference.lit import trace_lit

SMOKE = Medium(extinction_per_m=8.0)


@pytest.fixture
def view(blob_frame: DensityFrame) -> Camera:
    return Camera.around(blob_frame.grid, yaw_deg=40.0, pitch_deg=10.0, width_px=24, height_px=24)


def test_a_sun_shows_its_colour_times_the_map(blob_frame: DensityFrame, view: Camera, device: str) -> None:
    sun = DirectionalLight(to_light=(1.0, 0.0, 0.0), colour=(2.0, 1.0, 0.0))
    lit = trace_lit(blob_frame, view, SMOKE, [sun], samples=256, device=device)
    expected = trace_lightmaps(blob_frame, view, SMOKE, samples=32)["right"]
    np.testing.assert_allclose(lit.mean((0, 1)), np.array([2.0, 1.0, 0.0]) * expected.mean(), rtol=0.02)
    np.testing.assert_allclose(lit[..., 0], 2.0 * lit[..., 1], rtol=1e-5)  # linear in the light
    half = lit[:, 12:, 1].sum() / lit[..., 1].sum()
    assert half == pytest.approx(expected[:, 12:].sum() / expected.sum(), abs=0.02)


def test_lamps_far_away_are_suns_and_lights_add_up(blob_frame: DensityFrame, view: Camera, device: str) -> None:
    x, y, z = (100.0 * v for v in view.to_world((0.0, 1.0, 0.0)))
    point = PointLight(position_m=(x, y, z), intensity=(np.pi * 1e4, 0.0, 0.0))
    towards = (-x / 100.0, -y / 100.0, -z / 100.0)
    spot = SpotLight(position_m=(x, y, z), towards=towards, intensity=(0.0, np.pi * 1e4, 0.0))
    sun = DirectionalLight(to_light=(0.0, 1.0, 0.0), colour=(0.0, 0.0, 1.0))
    red, green, blue = trace_lit(blob_frame, view, SMOKE, [point, spot, sun], samples=256, device=device).mean((0, 1))
    assert red == pytest.approx(blue, rel=0.03)
    assert green == pytest.approx(blue, rel=0.03)


def test_a_spot_lights_its_cone_only(blob_frame: DensityFrame, view: Camera, device: str) -> None:
    x, y, z = view.to_world((1.0, 0.0, 0.0))
    away = SpotLight(position_m=(2 * x, 2 * y, 2 * z), towards=(x, y, z), intensity=(1.0, 1.0, 1.0))
    assert not trace_lit(blob_frame, view, SMOKE, [away], samples=8, device=device).any()


def test_an_environment_is_not_seen_itself_and_white_smoke_vanishes_in_it(
    blob_frame: DensityFrame, view: Camera, device: str
) -> None:
    sky = ConstantEnvironment(radiance=(1.0, 0.5, 0.25))
    lit = trace_lit(blob_frame, view, SMOKE, [sky], bounces="multi", samples=1024, device=device)
    alpha = trace_lightmaps(blob_frame, view, SMOKE, samples=1)["alpha"]
    np.testing.assert_allclose(lit.mean((0, 1)), np.array([1.0, 0.5, 0.25]) * alpha.mean(), rtol=0.02)
    assert not lit[0, 0].any()


@pytest.mark.parametrize(
    "obstacle",
    [
        Sphere(centre_m=(0.9, 0.0, 0.0), radius_m=0.8),
        Box(centre_m=(0.7, 0.0, 0.0), size_m=(0.2, 1.6, 1.6)),
        Cylinder(start_m=(0.6, 0.0, 0.0), end_m=(0.8, 0.0, 0.0), radius_m=0.9),
    ],
)
def test_obstacles_cast_shadows_and_hide(blob_frame: DensityFrame, device: str, obstacle: Obstacle) -> None:
    """Between the smoke and the sun on the right, then between the smoke and the camera."""
    camera = Camera.orthographic(position_m=(0.0, 0.0, 4.0), target_m=(0.0, 0.0, 0.0), width_px=16, height_px=16)
    left, right = (DirectionalLight(to_light=(side, 0.0, 0.0)) for side in (-1.0, 1.0))
    free, shadowed = (
        trace_lit(blob_frame, camera, SMOKE, [right], obstacles=o, samples=64, device=device).sum()
        for o in ((), (obstacle,))
    )
    assert shadowed < 0.2 * free
    unshadowed = trace_lit(blob_frame, camera, SMOKE, [left], obstacles=[obstacle], samples=64, device=device)
    assert unshadowed[:, :8].sum() > 0.4 * free
    behind = Camera.orthographic(position_m=(4.0, 0.0, 0.0), target_m=(0.0, 0.0, 0.0), width_px=16, height_px=16)
    hidden = trace_lit(blob_frame, behind, SMOKE, [left], obstacles=[obstacle], samples=16, device=device)
    assert hidden.max() < 1e-3


def test_what_cannot_be_lit_is_refused(blob_frame: DensityFrame, view: Camera, device: str) -> None:
    solid = replace(blob_frame, obstacle=np.ones_like(blob_frame.density))
    with pytest.raises(ValueError, match="describe them in `obstacles`"):
        trace_lit(solid, view, SMOKE, [])
    with pytest.raises(ValueError, match="at least 1"):
        trace_lit(blob_frame, view, SMOKE, [], samples=0)
    assert not trace_lit(blob_frame, view, SMOKE, [], device=device).any()


@pytest.mark.parametrize(
    "make",
    [
        lambda: DirectionalLight(to_light=(1.0, 1.0, 0.0)),
        lambda: PointLight(position_m=(0.0, 0.0, float("nan")), intensity=(1.0, 1.0, 1.0)),
        lambda: PointLight(position_m=(0.0, 0.0, 0.0), intensity=(1.0, -1.0, 1.0)),
        lambda: SpotLight(
            position_m=(0.0, 0.0, 0.0), towards=(0.0, 0.0, 1.0), intensity=(1.0, 1.0, 1.0), cutoff_deg=10.0
        ),
        lambda: ConstantEnvironment(radiance=(float("inf"), 0.0, 0.0)),
        lambda: Sphere(centre_m=(0.0, 0.0, 0.0), radius_m=0.0),
        lambda: Cylinder(start_m=(0.0, 0.0, 0.0), end_m=(0.0, 0.0, 0.0), radius_m=1.0),
        lambda: Box(centre_m=(0.0, 0.0, 0.0), size_m=(1.0, -1.0, 1.0)),
    ],
)
def test_impossible_lights_and_solids_are_refused(make) -> None:
    with pytest.raises(ValueError, match="must be|needs"):
        make()
