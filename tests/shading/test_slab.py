"""Slabs from the depth that rays see: the closed forms against sums, and volumes that are slabs."""

import numpy as np
import pytest

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.shading.slab import SmokeSlab

GRID = Grid(shape_zyx=(40, 40, 40), voxel_size_m=0.025, origin_m=(0.3, -1.0, 2.0))
CAMERA = Camera.around(GRID, kind="orthographic", width_px=12, height_px=8)
SHAPE = (8, 12)


def seen_moments(depth: float, begins_m: float, thickness_m: float) -> tuple[float, float]:
    """Mean and standard deviation of where rays end in an even slab, summed over a fine grid."""
    share = (np.arange(200_000) + 0.5) / 200_000
    ends = np.exp(-depth * share)
    ends /= ends.sum()
    at = begins_m + thickness_m * share
    mean = float((ends * at).sum())
    return mean, float(np.sqrt((ends * (at - mean) ** 2).sum()))


@pytest.mark.parametrize("depth", [0.002, 0.09, 0.11, 0.7, 3.0, 5.9])
def test_a_slab_is_found_from_its_own_moments(depth: float) -> None:
    mean, spread = seen_moments(depth, 3.2, 0.7)
    alpha = np.full(SHAPE, -np.expm1(-depth))
    slab = SmokeSlab.from_moments(CAMERA, alpha, np.full(SHAPE, mean), np.full(SHAPE, spread))
    np.testing.assert_allclose(slab.optical_depth, depth, rtol=1e-6)
    np.testing.assert_allclose(slab.thickness_m, 0.7, rtol=1e-5)
    np.testing.assert_allclose(slab.begins_m, 3.2, rtol=1e-6)
    np.testing.assert_allclose(slab.extinction_per_m, depth / 0.7, rtol=1e-5)


def test_opaque_and_empty_pixels_have_slabs_too() -> None:
    alpha = np.linspace(0.0, 1.0, 96).reshape(SHAPE)
    slab = SmokeSlab.from_moments(CAMERA, alpha, np.full(SHAPE, 2.0), np.full(SHAPE, 0.1))
    assert slab.optical_depth.min() == 1e-3 and slab.optical_depth.max() == 6.0
    assert (np.diff(slab.thickness_m.ravel()) > 0.0).all()  # for one spread: what lies deep counts ever less


def test_an_even_box_is_its_own_slab() -> None:
    density = np.zeros(GRID.shape_zyx, np.float32)
    density[8:32] = 1.0  # 0.6 m along z, which the camera looks along
    medium = Medium(extinction_per_m=5.0)
    slab = SmokeSlab.from_frame(DensityFrame(density=density, grid=GRID), medium, CAMERA)
    inside = (slice(2, 6), slice(4, 8))
    np.testing.assert_allclose(slab.optical_depth[inside], 3.0, rtol=0.01)
    np.testing.assert_allclose(slab.thickness_m[inside], 0.6, rtol=0.03)
    front = CAMERA.position_m[2] - (GRID.origin_m[2] + 32 * 0.025)
    np.testing.assert_allclose(slab.begins_m[inside], front, atol=0.01)


def test_without_smoke_slabs_are_thin_and_stand_at_the_target() -> None:
    empty = DensityFrame(density=np.zeros(GRID.shape_zyx, np.float32), grid=GRID)
    camera = Camera.around(GRID, yaw_deg=20.0, pitch_deg=10.0, width_px=12, height_px=8)
    slab = SmokeSlab.from_frame(empty, Medium(extinction_per_m=5.0), camera)
    origins, towards = camera.rays()
    middle = origins + (slab.begins_m + 0.5 * slab.thickness_m)[..., None] * towards
    np.testing.assert_allclose((middle - camera.target_m) @ np.array(camera.to_viewer), 0.0, atol=1e-4)
    assert slab.optical_depth.max() == 1e-3 and slab.thickness_m.max() < 0.1


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("begins_m", np.full(SHAPE, np.inf), "begins_m must be finite"),
        ("thickness_m", np.zeros(SHAPE), "thickness_m must be finite and positive"),
        ("optical_depth", np.full(SHAPE, np.nan), "optical_depth must be finite"),
    ],
)
def test_slabs_that_make_no_sense_are_refused(name: str, value: np.ndarray, message: str) -> None:
    planes = dict.fromkeys(("begins_m", "thickness_m", "optical_depth"), np.ones(SHAPE)) | {name: value}
    with pytest.raises(ValueError, match=message):
        SmokeSlab(camera=CAMERA, **planes)


def test_slabs_fit_their_camera() -> None:
    small = dict.fromkeys(("begins_m", "thickness_m", "optical_depth"), np.ones((8, 8)))
    with pytest.raises(ValueError, match="slab begins_m has shape"):
        SmokeSlab(camera=CAMERA, **small)


def test_an_albedo_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="albedo 1.5"):
        SmokeSlab.from_moments(CAMERA, np.ones(SHAPE), np.ones(SHAPE), np.ones(SHAPE), albedo=1.5)
    frame = DensityFrame(density=np.ones(GRID.shape_zyx, np.float32), grid=GRID)
    with pytest.raises(ValueError, match="RGB"):
        SmokeSlab.from_frame(frame, Medium(extinction_per_m=1.0, albedo=(0.9, 0.8, 0.7)), CAMERA)
