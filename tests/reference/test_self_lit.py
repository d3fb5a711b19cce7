"""Smoke lit by its own fire: the point-light limit, and light that is neither lost nor made."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.reference.variant import use_variant

VOXELS = 24
PIXELS = 24
CAMERA = Camera.orthographic(position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), width_px=PIXELS, height_px=PIXELS)


def fireball(*, smoke_m: float, fire_m: float) -> DensityFrame:
    """A ball of smoke with a ball of fire in its middle, in a cube of edge 1 m."""
    centres = (np.arange(VOXELS) + 0.5) / VOXELS - 0.5
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij")
    radius = np.sqrt(x * x + y * y + z * z)
    density, emission = (
        np.clip((edge - radius) * VOXELS + 0.5, 0.0, 1.0).astype(np.float32) for edge in (smoke_m, fire_m)
    )
    return DensityFrame(density=density, grid=Grid.centred(density.shape), emission=emission)


def self_lit(frame: DensityFrame, medium: Medium, device: str, **options: object) -> np.ndarray:
    use_variant(device)
    from sixway.reference.self_lit import trace_self_lit

    return trace_self_lit(frame, CAMERA, medium, **options)


def test_a_small_fire_in_thin_smoke_is_a_point_light(device: str) -> None:
    """L(b) = sigma_s I / (4 pi) * integral of dz / (b^2 + z^2) = sigma_s I / (4 pi b) * 2 atan(z_max / b)."""
    frame = fireball(smoke_m=0.5, fire_m=0.07)
    sigma_s = 0.7e-3
    image = self_lit(frame, Medium(extinction_per_m=1e-3, albedo=0.7), device, bounces="single", samples=512)
    intensity = float(frame.emission.sum()) / VOXELS**3
    axis = (np.arange(PIXELS) + 0.5) / PIXELS - 0.5
    b = np.hypot(*np.meshgrid(axis, axis))
    ring = (b > 0.2) & (b < 0.4)
    expected = sigma_s * intensity / (4.0 * math.pi * b) * 2.0 * np.arctan(np.sqrt(np.maximum(0.25 - b * b, 0.0)) / b)
    assert image[ring].sum() / expected[ring].sum() == pytest.approx(1.0, abs=0.02)
    near, far = ((b > low) & (b < low + 0.06) for low in (0.2, 0.34))
    for part in (near, far):
        assert image[part].sum() / expected[part].sum() == pytest.approx(1.0, abs=0.04)


@pytest.mark.parametrize(("extinction_per_m", "fire_m"), [(4.0, 0.12), (10.0, 0.3)])
def test_white_smoke_loses_none_of_its_fires_light(device: str, extinction_per_m: float, fire_m: float) -> None:
    """A ball alike from all sides sends the camera 1 / (4 pi) of its power: the volume of the fire."""
    frame = fireball(smoke_m=0.42, fire_m=fire_m)
    medium = Medium(extinction_per_m=extinction_per_m)
    lit = self_lit(frame, medium, device, bounces="multi", samples=32)
    tracer = LightmapTracer(ReferenceConfig(bounces="single", samples=1), medium, device=device)
    emissive = tracer.trace(frame, CAMERA, seed=0)["emissive"]
    sent = float(frame.emission.sum()) / VOXELS**3
    assert emissive.sum() / PIXELS**2 < 0.6 * sent  # most of it is scattered on its way
    assert (emissive.sum() + lit.sum()) / PIXELS**2 == pytest.approx(sent, rel=0.01)


def test_every_bounce_takes_the_albedo_once_more(device: str) -> None:
    frame = fireball(smoke_m=0.42, fire_m=0.2)

    def image(albedo: float, bounces: str, seed: int = 0) -> np.ndarray:
        medium = Medium(extinction_per_m=8.0, albedo=albedo)
        return self_lit(frame, medium, device, bounces=bounces, samples=16, seed=seed)

    once, twice = image(0.9, "single"), image(0.9, "paper")
    np.testing.assert_allclose(image(0.45, "single"), once / 2.0, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(image(0.45, "paper"), once / 2.0 + (twice - once) / 4.0, rtol=1e-4, atol=1e-6)
    assert once.sum() < twice.sum() < image(0.9, "multi").sum()
    np.testing.assert_array_equal(image(0.9, "single"), once)
    assert 0.0 < np.abs(image(0.9, "single", seed=1) - once).max() < 0.2 * once.max()


def test_nothing_is_lit_without_fire_or_smoke(device: str) -> None:
    frame = fireball(smoke_m=0.42, fire_m=0.2)
    for dark in (
        replace(frame, emission=None),
        replace(frame, emission=np.zeros_like(frame.density)),
        replace(frame, density=np.zeros_like(frame.density)),
    ):
        image = self_lit(dark, Medium(extinction_per_m=5.0), device)
        assert image.shape == (PIXELS, PIXELS)
        assert not image.any()


def test_all_bounces_of_anisotropic_smoke_are_refused(device: str) -> None:
    with pytest.raises(ValueError, match="'paper' or 'single'"):
        self_lit(fireball(smoke_m=0.4, fire_m=0.2), Medium(extinction_per_m=5.0, hg_g=0.5), device, bounces="multi")
