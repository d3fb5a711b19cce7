"""Cameras: the axes that everything else leans on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sixway.core.conventions import ADAPTER_PAIRS, DIRECTIONS, LIGHTMAP_CHANNELS, OPPOSITE, TO_LIGHT
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame

GRID = Grid.centred((8, 12, 10), longest_edge_m=2.0)


def test_opposite_lights_point_apart_and_every_channel_has_an_adapter() -> None:
    for name in DIRECTIONS:
        assert TO_LIGHT[OPPOSITE[name]] == tuple(-v for v in TO_LIGHT[name])
        assert OPPOSITE[OPPOSITE[name]] == name
    assert sorted(c for pair in ADAPTER_PAIRS for c in pair) == sorted(LIGHTMAP_CHANNELS)


def test_grid_is_centred_and_measures_itself() -> None:
    assert GRID.extent_m == pytest.approx((10 / 6, 2.0, 8 / 6))
    assert GRID.centre_m == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize("bad", [{"shape_zyx": (0, 1, 1)}, {"voxel_size_m": 0.0}, {"voxel_size_m": float("nan")}])
def test_impossible_grids_are_refused(bad: dict) -> None:
    with pytest.raises(ValueError, match="grid|voxel"):
        Grid(**{"shape_zyx": (1, 1, 1), "voxel_size_m": 1.0} | bad)


def test_yaw_zero_looks_along_minus_z_and_yaw_90_from_plus_x() -> None:
    front = Camera.around(GRID)
    np.testing.assert_allclose(front.basis, np.eye(3), atol=1e-12)
    assert front.position_m[2] > 0.0
    side = Camera.around(GRID, yaw_deg=90.0)
    np.testing.assert_allclose(side.to_viewer, (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(side.right, (0, 0, -1), atol=1e-12)
    above = Camera.around(GRID, pitch_deg=60.0)
    assert above.position_m[1] > 0.0


@given(yaw=st.floats(-360, 360), pitch=st.floats(-89, 89))
def test_camera_axes_are_right_handed(yaw: float, pitch: float) -> None:
    basis = Camera.around(GRID, yaw_deg=yaw, pitch_deg=pitch).basis
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(basis) == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_rays_go_where_the_image_says(kind: str) -> None:
    camera = Camera.around(GRID, kind=kind, width_px=30, height_px=20)
    origins, forward = camera.rays()
    assert forward.shape == (20, 30, 3)
    at_target = origins + forward * (camera.distance_m / -forward[..., 2:3])
    assert at_target[0, 0, 0] < 0 < at_target[0, -1, 0]  # left and right
    assert at_target[-1, 0, 1] < 0 < at_target[0, 0, 1]  # row 0 is the top
    np.testing.assert_allclose(at_target.mean((0, 1)), camera.target_m, atol=1e-9)
    np.testing.assert_allclose(at_target[0, 0, 0], -camera.half_width_m * 29 / 30, rtol=1e-9)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("size", [(64, 64), (96, 48), (40, 80)])
def test_no_view_crops_the_volume(kind: str, size: tuple[int, int]) -> None:
    camera = Camera.around(GRID, yaw_deg=45.0, pitch_deg=35.0, kind=kind, width_px=size[0], height_px=size[1])
    x, y, z = GRID.extent_m
    for sx in (-0.5, 0.5):
        for sy in (-0.5, 0.5):
            for sz in (-0.5, 0.5):
                u, v, w = camera.basis @ np.array([sx * x, sy * y, sz * z])
                shrink = camera.distance_m / (camera.distance_m - w) if kind == "perspective" else 1.0
                assert abs(u * shrink) <= camera.half_width_m
                assert abs(v * shrink) <= camera.half_height_m


@pytest.mark.parametrize("bad", [{"pitch_deg": 90.0}, {"fov_deg": 0.0}, {"width_px": 0}])
def test_impossible_cameras_are_refused(bad: dict) -> None:
    with pytest.raises(ValueError, match="pitch|field of view|at least 1"):
        Camera.around(GRID, **bad)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_a_placed_camera_stands_where_it_is_told(kind: str) -> None:
    around = Camera.around(GRID, kind=kind, yaw_deg=40.0, pitch_deg=20.0, fov_deg=50.0, width_px=30, height_px=40)
    place = {"position_m": around.position_m, "target_m": around.target_m, "width_px": 30, "height_px": 40}
    if kind == "perspective":
        placed = Camera.perspective(**place, fov_deg=50.0)
    else:
        placed = Camera.orthographic(**place, size_m=2.0 * around.half_width_m)
    for ours, theirs in zip(placed.rays(), around.rays(), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_up_rolls_a_placed_camera() -> None:
    camera = Camera.perspective(position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), up=(-2.0, 0.0, 0.5))
    np.testing.assert_allclose(camera.basis, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize("bad", [{"position_m": (0.0, 0.0, 0.0)}, {"up": (0.0, 0.0, 1.0)}, {"up": (0.0, 0.0, 0.0)}])
def test_a_camera_that_cannot_tell_right_is_refused(bad: dict) -> None:
    with pytest.raises(ValueError, match="no direction to the right"):
        Camera.orthographic(**{"position_m": (0.0, 0.0, 3.0), "target_m": (0.0, 0.0, 0.0)} | bad)


def test_emission_is_checked_as_density_is() -> None:
    density = np.zeros(GRID.shape_zyx, np.float32)
    assert DensityFrame(density=density, grid=GRID).emission is None
    with pytest.raises(ValueError, match="emission"):
        DensityFrame(density=density, grid=GRID, emission=density - 1.0)
