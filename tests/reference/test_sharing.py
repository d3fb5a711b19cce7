"""Views of one frame, colours of one smoke and wide lights: what is shared may not change the pictures."""

import numpy as np
import pytest

from sixway.core.conventions import DIRECTIONS, Bounces
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig, trace_lightmaps, trace_rgb_lightmaps
from sixway.reference.lights import DirectionalLight, sun_disc
from sixway.reference.lit import trace_lit

SMOKE = Medium(extinction_per_m=8.0)


def level(frame: DensityFrame, *yaws_deg: float) -> list[Camera]:
    return [Camera.around(frame.grid, yaw_deg=yaw, width_px=24, height_px=24) for yaw in yaws_deg]


@pytest.mark.parametrize("bounces", ["single", "paper", "multi"])
def test_views_that_share_light_agree_with_views_alone(blob_frame: DensityFrame, device: str, bounces: Bounces) -> None:
    tracer = LightmapTracer(ReferenceConfig(bounces=bounces, samples=32), SMOKE, device=device)
    cameras = level(blob_frame, 0.0, 40.0, 90.0)
    shared = list(tracer.trace_views(blob_frame, cameras, seeds=[1, 2, 3]))
    alone = [tracer.trace(blob_frame, camera, seed=seed) for camera, seed in zip(cameras, (1, 2, 3), strict=True)]
    assert len(shared) == 3
    np.testing.assert_array_equal(shared[0].maps[..., 0], alone[0].maps[..., 0])
    for one, other in zip(shared, alone, strict=True):
        np.testing.assert_array_equal(one["alpha"], other["alpha"])
        np.testing.assert_allclose(one.maps.mean((0, 1)), other.maps.mean((0, 1)), rtol=0.005)
        assert np.sqrt(np.mean((one.maps - other.maps) ** 2)) < 0.03 * other.maps.mean()


@pytest.mark.parametrize("method", ["path", "stock"])
def test_methods_that_share_nothing_trace_views_too(blob_frame: DensityFrame, device: str, method: str) -> None:
    tracer = LightmapTracer(ReferenceConfig(method=method, samples=4), SMOKE, device=device)
    cameras = level(blob_frame, 0.0, 90.0)
    for lightmap, camera in zip(tracer.trace_views(blob_frame, cameras, seeds=[5, 6]), cameras, strict=True):
        seed = 5 + cameras.index(camera)
        np.testing.assert_array_equal(lightmap.image, tracer.trace(blob_frame, camera, seed=seed).image)


def test_every_camera_needs_its_seed(blob_frame: DensityFrame, device: str) -> None:
    tracer = LightmapTracer(ReferenceConfig(), SMOKE, device=device)
    with pytest.raises(ValueError, match="2 cameras need as many seeds"):
        tracer.trace_views(blob_frame, level(blob_frame, 0.0, 1.0), seeds=[1])


@pytest.mark.parametrize("method", ["cached", "path", "stock"])
def test_equal_albedos_give_equal_bytes_and_darker_ones_less_light(
    blob_frame: DensityFrame, device: str, method: str
) -> None:
    coloured = Medium(extinction_per_m=8.0, albedo=(0.9, 0.4, 0.9))
    (camera,) = level(blob_frame, 30.0)
    red, green, blue = trace_rgb_lightmaps(blob_frame, camera, coloured, method=method, samples=16, device=device)
    np.testing.assert_array_equal(red.image, blue.image)
    grey = Medium(extinction_per_m=8.0, albedo=0.4)
    alone = trace_lightmaps(blob_frame, camera, grey, method=method, samples=16)
    np.testing.assert_array_equal(green.image, alone.image)
    assert green.maps.mean() < 0.45 * red.maps.mean()  # less than in proportion: it scatters twice


def test_colours_are_refused_where_one_number_is_needed_and_lit_pictures_show_them(
    blob_frame: DensityFrame, device: str
) -> None:
    coloured = Medium(extinction_per_m=8.0, albedo=(0.9, 0.4, 0.4))
    with pytest.raises(ValueError, match="trace_rgb_lightmaps"):
        LightmapTracer(ReferenceConfig(), coloured, device=device)
    with pytest.raises(ValueError, match="red, green, blue"):
        Medium(extinction_per_m=1.0, albedo=(0.5, 0.5, 1.5))
    (camera,) = level(blob_frame, 30.0)
    lit = trace_lit(blob_frame, camera, coloured, [DirectionalLight(to_light=(0.0, 1.0, 0.0))], samples=256)
    maps = trace_rgb_lightmaps(blob_frame, camera, coloured, samples=32, device=device)
    np.testing.assert_allclose(lit.mean((0, 1)), [colour["top"].mean() for colour in maps], rtol=0.02)


def test_a_disc_is_even_and_its_opposite_opposite() -> None:
    for axis in ((0.0, 0.0, 1.0), (0.6, 0.0, -0.8), (-0.48, 0.6, 0.64)):
        disc = np.array(sun_disc(axis, 20.0))
        np.testing.assert_allclose(np.linalg.norm(disc, axis=1), 1.0, atol=1e-12)
        cosines = disc @ axis
        assert np.degrees(np.arccos(cosines.min())) <= 10.0
        assert cosines.mean() == pytest.approx((1.0 + np.cos(np.radians(10.0))) / 2.0, abs=1e-9)
        mean = disc.mean(0) / np.linalg.norm(disc.mean(0))
        assert mean @ axis > np.cos(np.radians(1.0))
        opposite = sun_disc((-axis[0], -axis[1], -axis[2]), 20.0)
        np.testing.assert_allclose(np.array(opposite), -disc, atol=1e-12)
    assert sun_disc((0.0, 1.0, 0.0), 0.0) == [(0.0, 1.0, 0.0)]
    with pytest.raises(ValueError, match="deg wide"):
        DirectionalLight(to_light=(0.0, 1.0, 0.0), angle_deg=90.0)


def test_wide_lights_agree_between_methods_and_soften_shadows(blob_frame: DensityFrame, device: str) -> None:
    (camera,) = level(blob_frame, 33.0)
    maps = {
        (method, angle): LightmapTracer(
            ReferenceConfig(method=method, samples=samples, light_angle_deg=angle), SMOKE, device=device
        ).trace(blob_frame, camera, seed=1)
        for method, samples, angle in (
            ("cached", 16, 40.0),
            ("path", 8192, 40.0),
            ("stock", 512, 40.0),
            ("cached", 16, 0.0),
        )
    }
    soft = maps["path", 40.0].maps.mean((0, 1))
    np.testing.assert_allclose(maps["cached", 40.0].maps.mean((0, 1)), soft, rtol=0.008)
    np.testing.assert_allclose(maps["stock", 40.0].maps.mean((0, 1)), soft, rtol=0.03)
    difference = [np.abs(maps["cached", 40.0][name] - maps["cached", 0.0][name]).mean() for name in DIRECTIONS]
    assert min(difference) > 0.005 * soft.mean()
    wide = DirectionalLight(to_light=(1.0, 0.0, 0.0), angle_deg=40.0)
    lit = trace_lit(blob_frame, camera, SMOKE, [wide], samples=512, device=device)
    assert lit[..., 0].mean() == pytest.approx(float(soft[0]), rel=0.02)
