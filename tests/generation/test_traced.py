"""References in two halves: their noise estimate is true, and company changes nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.generation.traced import HalvedTracer
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.volumes.npz import read_npz

MEDIUM = Medium(extinction_per_m=40.0)


@pytest.fixture(scope="module")
def jet() -> DensityFrame:
    whole = read_npz(Path(__file__).parents[1] / "data/jet.npz").density
    density = whole.reshape(16, 2, 16, 2, 16, 2).mean(axis=(1, 3, 5))
    return DensityFrame(density=density, grid=Grid.centred(density.shape))


@pytest.fixture(scope="module")
def cameras(jet: DensityFrame) -> list[Camera]:
    return [Camera.around(jet.grid, yaw_deg=yaw, width_px=16, height_px=12) for yaw in (0.0, 30.0, 90.0)]


def images(tracer: HalvedTracer, frame: DensityFrame, cameras: list[Camera], seed: int = 5) -> list[np.ndarray]:
    return [traced.lightmap.image for traced in tracer.trace_views(frame, cameras, seed=seed)]


def test_the_mean_of_the_halves_and_their_difference(jet: DensityFrame, cameras: list[Camera]) -> None:
    halves = LightmapTracer(ReferenceConfig(samples=2), MEDIUM, device="cpu")
    a, b = (halves.trace(jet, cameras[0], seed=seed) for seed in (7, 7 ^ 0x5EED))
    (traced,) = HalvedTracer(ReferenceConfig(samples=3), MEDIUM, device="cpu").trace_views(jet, cameras[:1], seed=7)
    np.testing.assert_allclose(traced.lightmap.image, (a.image + b.image) / 2.0, rtol=1e-6)
    assert traced.noise_rmse == pytest.approx(np.sqrt(np.mean((a.maps - b.maps) ** 2)) / 2.0, rel=1e-5)


def test_the_noise_told_is_the_noise_there_is(jet: DensityFrame, cameras: list[Camera]) -> None:
    """Over several seeds: the true error against many samples, and the estimate, which knows no truth."""
    truth = LightmapTracer(ReferenceConfig(samples=256), MEDIUM, device="cpu").trace(jet, cameras[0], seed=99).maps
    tracer = HalvedTracer(ReferenceConfig(samples=8), MEDIUM, device="cpu")
    told, true = [], []
    for seed in range(10):
        (traced,) = tracer.trace_views(jet, cameras[:1], seed=seed)
        told.append(traced.noise_rmse**2)
        true.append(np.mean((traced.lightmap.maps - truth) ** 2))
    assert np.sqrt(np.mean(told)) == pytest.approx(np.sqrt(np.mean(true)), rel=0.2)


@pytest.mark.parametrize("bounces", ["single", "paper"])
def test_company_changes_the_last_bits_of_a_view_at_most(
    jet: DensityFrame, cameras: list[Camera], bounces: str
) -> None:
    tracer = HalvedTracer(ReferenceConfig(samples=2, bounces=bounces), MEDIUM, device="cpu")
    assert tracer.depends_on_company
    together = images(tracer, jet, cameras)
    alone = [images(tracer, jet, [camera])[0] for camera in cameras]
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)
    for one, other in zip(images(tracer, jet, cameras), together, strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_has_no_chance_in_it_has_no_noise(jet: DensityFrame, cameras: list[Camera]) -> None:
    config = ReferenceConfig(samples=4, bounces="single")
    (traced,) = HalvedTracer(config, MEDIUM, device="cpu").trace_views(jet, cameras[:1], seed=1)
    assert traced.noise_rmse == 0.0 and traced.noise_psnr_db is None
    empty = replace(jet, density=np.zeros_like(jet.density))
    (traced,) = HalvedTracer(ReferenceConfig(), MEDIUM, device="cpu").trace_views(empty, cameras[:1], seed=1)
    assert traced.noise_rmse == 0.0 and traced.noise_psnr_db is None


def test_fire_passes_through(jet: DensityFrame, cameras: list[Camera]) -> None:
    burning = replace(jet, emission=3.0 * jet.density)
    tracer = HalvedTracer(ReferenceConfig(samples=2), MEDIUM, device="cpu")
    (traced,) = tracer.trace_views(burning, cameras[:1], seed=1)
    assert traced.lightmap["emissive"].max() > 0.01
