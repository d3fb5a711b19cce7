"""The unbiased paths against Mitsuba's own, and what follows from physics alone."""

import numpy as np

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig


def replicates(frame: DensityFrame, camera: Camera, medium: Medium, count: int, device: str, **config) -> np.ndarray:
    """[count, h, w, 6] independent pictures."""
    tracer = LightmapTracer(ReferenceConfig(**config), medium, device=device)
    return np.stack([tracer.trace(frame, camera, seed=seed).maps for seed in range(count)])


def test_path_agrees_with_stock_within_its_noise(blob_frame: DensityFrame, device: str) -> None:
    """In the mean and in blocks of 8 x 8, with every bounce and smoke that absorbs and scatters forwards."""
    medium = Medium(extinction_per_m=10.0, albedo=0.8, hg_g=0.4)
    camera = Camera.around(blob_frame.grid, yaw_deg=33.0, pitch_deg=20.0, width_px=32, height_px=32)
    path = replicates(blob_frame, camera, medium, 6, device, method="path", bounces="multi", samples=512)
    stock = replicates(blob_frame, camera, medium, 6, device, method="stock", bounces="multi", samples=96)
    for block in (32, 8):
        scores = []
        for pictures in (path, stock):
            pooled = pictures.reshape(6, 32 // block, block, 32 // block, block, 6).mean(axis=(2, 4))
            scores.append((pooled.mean(0), pooled.var(0, ddof=1) / 6))
        (a, var_a), (b, var_b) = scores
        seen = a > 0.05 * a.max()
        z = (a - b)[seen] / np.sqrt(var_a + var_b)[seen]
        assert np.mean(np.abs(z) > 3.0) <= 0.05, z  # Student's t of ten degrees of freedom: 1.3 %
        assert np.sqrt(np.mean(z**2)) < 1.6


def test_noise_falls_with_the_root_of_samples(blob_frame: DensityFrame, device: str) -> None:
    camera = Camera.around(blob_frame.grid, width_px=32, height_px=32)
    few, many = (
        replicates(blob_frame, camera, Medium(extinction_per_m=10.0), 4, device, method="path", samples=samples)
        for samples in (64, 1024)
    )
    ratio = np.sqrt(few.var(0, ddof=1).mean() / many.var(0, ddof=1).mean())
    assert 3.5 < ratio < 4.5


def test_smoke_that_absorbs_nothing_vanishes_in_uniform_light(blob_frame: DensityFrame, device: str) -> None:
    """White furnace: light of radiance 1 from everywhere, here 96 suns, makes the picture equal to alpha."""
    from sixway.reference.variant import use_variant

    if use_variant(device).startswith("scalar"):
        return
    from sixway.reference.cached import CachedTracer
    from sixway.reference.path import PathTracer

    medium = Medium(extinction_per_m=6.0)
    camera = Camera.around(blob_frame.grid, width_px=24, height_px=24)
    z = 1.0 - (2.0 * np.arange(96) + 1.0) / 96.0
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(96)  # Fibonacci's spiral
    suns = np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=-1)
    sets = [[(float(a), float(b), float(c)) for a, b, c in suns[n : n + 6]] for n in range(0, 96, 6)]
    for tracer in (
        CachedTracer(bounces="multi", samples=4, medium=medium),
        PathTracer(bounces="multi", samples=256, medium=medium),
    ):
        images = [tracer.trace(blob_frame, camera, seed=n, to_lights=lights) for n, lights in enumerate(sets)]
        mean = np.mean(images, axis=0)
        furnace = 4.0 * mean[..., :6].mean(-1)  # L = sum of M / pi * 4 pi / 96
        assert abs(furnace.sum() / mean[..., 6].sum() - 1.0) < 0.01
