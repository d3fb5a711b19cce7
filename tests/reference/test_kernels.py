"""Streaming frames through a tracer compiles nothing anew."""

import numpy as np
import pytest

from sixway.core.conventions import Bounces
from sixway.core.frames import Camera
from sixway.core.records import Medium
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from tests.reference.conftest import blobs


def _kernels_of(trace) -> set[str]:
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        trace()
        return {entry["hash"] for entry in dr.kernel_history((dr.KernelType.JIT,))}


@pytest.mark.parametrize(
    ("method", "bounces"), [("cached", "paper"), ("cached", "multi"), ("path", "multi"), ("stock", "paper")]
)
def test_new_frames_seeds_and_poses_run_compiled_kernels(device: str, method: str, bounces: Bounces) -> None:
    config = ReferenceConfig(method=method, bounces=bounces, samples=4)
    tracer = LightmapTracer(config, Medium(extinction_per_m=9.0), device=device)
    if tracer.method != method:
        pytest.skip("no JIT variant here")

    def trace(seed: int) -> None:
        frame = blobs(seed)
        camera = Camera.around(frame.grid, yaw_deg=40.0 * seed, pitch_deg=5.0 * seed, width_px=24, height_px=24)
        tracer.trace(frame, camera, seed=seed)

    first = _kernels_of(lambda: trace(1))
    assert first
    assert _kernels_of(lambda: [trace(2), trace(3)]) <= first


def test_directions_follow_the_phase_function(device: str) -> None:
    """Sampled cosines have the mean g of Henyey and Greenstein, at the isotropic limit too."""
    from sixway.reference.variant import use_variant

    if use_variant("cpu").startswith("scalar"):
        pytest.skip("no JIT variant here")
    import mitsuba as mi

    from sixway.reference.kernels import sample_henyey_greenstein

    u = mi.Float((np.arange(20000) + 0.5) / 20000)
    for g in (-0.7, 0.0, 5e-4, 2e-3, 0.3, 0.9):
        vectors = np.array(sample_henyey_greenstein(u, mi.Float(0.0), mi.Float(g)))
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=0), 1.0, atol=1e-5)
        assert abs(vectors[2].mean() - g) < 2e-3
