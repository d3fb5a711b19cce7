"""Samples and exponentials, eight at once, against float64."""

import numpy as np
import warp as wp

from sixway.guide import oracle
from sixway.guide.ray_kernels import LANES, Lanes, exp_minus, trilinear_along


@wp.kernel
def sample_lines(
    field: wp.array3d(dtype=float),
    start: wp.array(dtype=wp.vec3),
    step: wp.array(dtype=wp.vec3),
    sampled: wp.array(dtype=Lanes),
):
    n = wp.tid()
    sampled[n] = trilinear_along(field, start[n], step[n])


@wp.kernel
def fade(depths: wp.array(dtype=Lanes), passed: wp.array(dtype=Lanes)):
    n = wp.tid()
    passed[n] = exp_minus(depths[n])


def test_samples_along_lines_through_and_around_the_grid(rng, device) -> None:
    field = rng.random((7, 1, 9), dtype=np.float32)  # one axis has a single voxel
    start = rng.uniform((-1.5, -1.0, -1.5), (10.5, 2.0, 8.5), (500, 3)).astype(np.float32)
    step = rng.normal(0.0, 0.4, (500, 3)).astype(np.float32)
    start[0], step[0] = 1e9, -1e9  # far beyond what a whole number holds
    sampled = wp.empty(500, dtype=Lanes, device=device)
    wp.launch(
        sample_lines,
        dim=500,
        inputs=[
            wp.array(field, dtype=float, device=device),
            wp.array(start, dtype=wp.vec3, device=device),
            wp.array(step, dtype=wp.vec3, device=device),
        ],
        outputs=[sampled],
        device=device,
    )
    lane = np.arange(LANES)[:, None]
    expected = oracle.sample(field, start[1:, None] + lane * step[1:, None])
    np.testing.assert_allclose(sampled.numpy()[1:], expected, atol=2e-5)
    assert (expected > 0.1).sum() > 100 and np.isfinite(sampled.numpy()).all()


def test_exponentials_are_right_to_the_last_bits(device) -> None:
    depths = np.concatenate([[0.0], np.geomspace(1e-8, 80.0, 796), [90.0, 1e4, 1e30]]).astype(np.float32).reshape(-1, 8)
    passed = wp.empty(len(depths), dtype=Lanes, device=device)
    wp.launch(
        fade, dim=len(depths), inputs=[wp.array(depths, dtype=Lanes, device=device)], outputs=[passed], device=device
    )
    got, expected = passed.numpy().ravel().astype(np.float64), np.exp(-depths.astype(np.float64)).ravel()
    assert got[0] == 1.0
    assert (got[-3:] < 1e-37).all() and (got[-3:] >= 0.0).all()
    relative = np.abs(got[:-3] / expected[:-3] - 1.0)
    assert relative[depths.ravel()[:-3] < 1.0].max() < 3e-7
    assert relative.max() < 1e-5  # at 80, half a last bit of the argument counts as much
