"""Motion in the image: closed forms, projected points, and the oracle."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.guide import oracle
from sixway.guide.motion import project_motion, project_motion_statistics


def sheets(*densities: float, speeds: list[tuple[float, float, float]], n: int = 16) -> DensityFrame:
    """Sheets across the view, the nearest first, each 2 voxels thick and moving by itself."""
    density = np.zeros((n, n, n), np.float32)
    wind = np.zeros((n, n, n, 3), np.float32)
    for place, (value, speed) in enumerate(zip(densities, speeds, strict=True)):
        far = n - 4 - 6 * place
        density[far : far + 2] = value
        wind[far - 1 : far + 4] = speed
    return DensityFrame(density=density, grid=Grid.centred((n, n, n)), velocity_m_s=wind)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_it_follows_a_uniform_wind(device, kind) -> None:
    n = 16
    wind = np.zeros((8, 8, 8, 3), np.float32)
    wind[...] = (0.2, -0.1, 0.0)
    density = np.zeros((n, n, n), np.float32)
    density[7:9, 4:12, 4:12] = 1.0
    frame = DensityFrame(density=density, grid=Grid.centred((n, n, n)), velocity_m_s=wind)
    camera = Camera.around(frame.grid, kind=kind, width_px=40, height_px=40)
    motion = project_motion_statistics(frame, camera, Medium(extinction_per_m=50.0), frame_s=0.5, device=device)
    px_per_m = 40 / (2.0 * camera.half_height_m)
    centre = motion.mean[18:22, 18:22].mean((0, 1))
    np.testing.assert_allclose(centre, [0.1 * px_per_m, 0.05 * px_per_m], rtol=0.03)
    assert (motion.mean[0, 0] == 0.0).all() and motion.alpha[0, 0] == 0.0
    assert motion.variance.max() < (1e-10 if kind == "orthographic" else 1e-2)


def test_two_sheets_that_move_apart_have_the_mean_and_variance_of_their_weights(device) -> None:
    frame = sheets(1.0, 2.0, speeds=[(0.3, 0.0, 0.0), (-0.3, 0.1, 0.0)])
    camera = Camera.around(frame.grid, kind="orthographic", width_px=32, height_px=32)
    sigma = 3.0
    motion = project_motion_statistics(frame, camera, Medium(extinction_per_m=sigma), frame_s=0.5, device=device)
    thickness = 2.0 / 16.0
    near = 1.0 - np.exp(-sigma * thickness)
    far = (1.0 - near) * (1.0 - np.exp(-2.0 * sigma * thickness))
    px_per_m = 32 / (2.0 * camera.half_height_m)
    speeds = 0.5 * px_per_m * np.array([[0.3, 0.0], [-0.3, -0.1]])  # right, down
    weights = np.array([near, far]) / (near + far)
    mean = weights @ speeds
    variance = weights @ (speeds - mean) ** 2
    centre = np.s_[14:18, 14:18]
    np.testing.assert_allclose(motion.alpha[centre], near + far, rtol=1e-3)
    np.testing.assert_allclose(motion.mean[centre], np.broadcast_to(mean, (4, 4, 2)), rtol=5e-3, atol=1e-5)
    np.testing.assert_allclose(motion.variance[centre], np.broadcast_to(variance, (4, 4, 2)), rtol=5e-3)


def test_smoke_that_comes_nearer_spreads_as_its_projected_points_do(device) -> None:
    frame = sheets(5.0, speeds=[(0.0, 0.0, 0.8)])
    camera = Camera.around(frame.grid, kind="perspective", fov_deg=60.0, width_px=40, height_px=40)
    frame_s = 1e-2
    medium = Medium(extinction_per_m=500.0)  # opaque at once: the motion is that of the sheet's face
    flow = project_motion(frame, camera, medium, frame_s=frame_s, device=device)
    face = frame.grid.origin_m[2] + 14.0 / 16.0
    origin, forward = camera.rays()
    points = origin + forward * ((face - origin[..., 2]) / forward[..., 2])[..., None]

    def in_image(world: np.ndarray) -> np.ndarray:
        x, y, z = np.moveaxis((world - np.array(camera.position_m)) @ camera.basis.T, -1, 0)
        right, down = x / -z * camera.distance_m, -y / -z * camera.distance_m
        return np.stack([right * 20.0 / camera.half_width_m, down * 20.0 / camera.half_height_m], axis=-1)

    expected = in_image(points + np.array([0.0, 0.0, 0.8 * frame_s])) - in_image(points)
    inside = np.s_[14:26, 14:26]
    assert np.abs(expected[inside]).max() > 0.02
    np.testing.assert_allclose(flow[inside], expected[inside], rtol=0.06, atol=3e-4)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_kernel_equals_oracle(rng, device, kind) -> None:
    shape = (14, 18, 16)
    density = gaussian_filter(rng.random(shape), 1.5)
    density = np.maximum(density - np.median(density), 0.0).astype(np.float32)
    density /= density.max()
    obstacle = np.zeros(shape, np.float32)
    obstacle[9:, :8, 3:9] = 1.0
    wind = rng.normal(size=(7, 9, 8, 3)).astype(np.float32)
    frame = DensityFrame(density=density, grid=Grid.centred(shape), velocity_m_s=wind, obstacle=obstacle)
    camera = Camera.around(frame.grid, yaw_deg=40.0, pitch_deg=15.0, kind=kind, width_px=21, height_px=17)
    medium = Medium(extinction_per_m=20.0)
    motion = project_motion_statistics(frame, camera, medium, frame_s=0.1, device=device, threads=2)
    mean, variance, alpha = oracle.image_motion(frame, camera, medium, frame_s=0.1)
    close = np.isclose(motion.mean, mean, rtol=1e-3, atol=2e-3).all(-1)
    close &= np.isclose(motion.variance, variance, rtol=2e-3, atol=2e-3).all(-1)
    close &= np.isclose(motion.alpha, alpha, atol=2e-4)
    assert close.mean() > 0.96  # an obstacle's face may fall the other way in float32
    assert np.median(variance[alpha > 0.5]) > 0.05
    np.testing.assert_array_equal(project_motion(frame, camera, medium, frame_s=0.1, device=device), motion.mean)


def test_a_frame_without_velocity_is_an_error_and_one_without_smoke_is_still(device) -> None:
    grid = Grid.centred((8, 8, 8))
    camera = Camera.around(grid, width_px=8, height_px=8)
    empty = np.zeros((8, 8, 8), np.float32)
    medium = Medium(extinction_per_m=5.0)
    with pytest.raises(ValueError, match="no velocity"):
        project_motion(DensityFrame(density=empty, grid=grid), camera, medium, frame_s=0.1, device=device)
    windy = DensityFrame(density=empty, grid=grid, velocity_m_s=np.ones((4, 4, 4, 3), np.float32))
    motion = project_motion_statistics(windy, camera, medium, frame_s=0.1, device=device)
    assert not motion.mean.any() and not motion.variance.any() and not motion.alpha.any()
