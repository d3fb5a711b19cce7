"""The six maps against closed forms, against Mitsuba's own path tracer, and against common sense."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sixway.core.conventions import DIRECTIONS, FLIP_HORIZONTAL, Bounces
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig, trace_lightmaps
from sixway.reference.oracle import cube_maps

SMOKE = Medium(extinction_per_m=12.0)


def tracer(device: str, medium: Medium = SMOKE, **config) -> LightmapTracer:
    return LightmapTracer(ReferenceConfig(**config), medium, device=device)


def pooled(image: np.ndarray, block: int = 8) -> np.ndarray:
    height, width, channels = image.shape
    return image.reshape(height // block, block, width // block, block, channels).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("method", "samples", "tolerance"), [("cached", 1, 0.003), ("path", 2048, 0.006), ("stock", 256, 0.02)]
)
def test_single_scattering_in_a_homogeneous_cube(
    cube_frame: DensityFrame, device: str, method: str, samples: int, tolerance: float
) -> None:
    pixels = 32
    medium = Medium(extinction_per_m=3.0, albedo=0.8)
    camera = Camera.orthographic(
        position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), width_px=pixels, height_px=pixels
    )
    maps = tracer(device, medium, method=method, bounces="single", samples=samples).trace(cube_frame, camera, seed=1)
    expected = cube_maps(3.0, albedo=0.8, voxels=32, pixels=pixels)
    inner = slice(2, -2)
    for name in DIRECTIONS:
        along = maps[name][inner, inner].mean(axis=1 if name in ("top", "bottom") else 0)
        error = np.mean(along / expected[name][inner]) - 1
        assert abs(error) < tolerance, f"{name}: {error:+.2%}"
    np.testing.assert_allclose(maps["alpha"][inner, inner], 1 - math.exp(-3.0), rtol=1e-3)


@pytest.mark.parametrize(
    ("kind", "bounces", "hg_g"),
    [
        ("perspective", "paper", 0.3),
        ("orthographic", "paper", -0.5),
        ("orthographic", "multi", 0.0),
        ("orthographic", "multi", 0.3),
    ],
)
def test_cached_agrees_with_path(
    blob_frame: DensityFrame, device: str, kind: str, bounces: Bounces, hg_g: float
) -> None:
    medium = Medium(extinction_per_m=7.0, albedo=0.9, hg_g=hg_g)
    camera = Camera.around(blob_frame.grid, kind=kind, yaw_deg=33.0, pitch_deg=20.0, width_px=48, height_px=32)
    samples = 8 if bounces == "multi" and hg_g != 0.0 else 32  # six moments take their time
    cached = tracer(device, medium, bounces=bounces, samples=samples).trace(blob_frame, camera, seed=1).image
    path = tracer(device, medium, bounces=bounces, method="path", samples=8192).trace(blob_frame, camera, seed=2).image
    np.testing.assert_allclose(cached.mean((0, 1)), path.mean((0, 1)), rtol=0.008)
    np.testing.assert_allclose(cached[..., 6], path[..., 6], atol=6e-4)
    difference = np.sqrt(np.mean((pooled(cached) - pooled(path)) ** 2, axis=(0, 1)))
    assert (difference <= 0.03 * path.mean((0, 1))).all(), difference / path.mean((0, 1))  # mostly the paths' noise


def test_scattered_light_of_thin_voxels_is_kept_on_a_coarser_grid(blob_frame: DensityFrame, device: str) -> None:
    camera = Camera.around(blob_frame.grid, width_px=32, height_px=32)
    thin = Medium(extinction_per_m=0.14 * 24 / float(blob_frame.density.max()))  # 0.14 in the thickest voxel
    coarse, fine = (
        tracer(device, thin, source_optical_depth=depth, samples=32).trace(blob_frame, camera, seed=1).image
        for depth in (0.3, 0.0)
    )
    assert not np.array_equal(coarse, fine)
    np.testing.assert_allclose(coarse.mean((0, 1)), fine.mean((0, 1)), rtol=0.006)


def test_thin_smoke_reads_a_quarter_of_its_optical_depth(blob_frame: DensityFrame, device: str) -> None:
    """M -> pi * albedo * tau / (4 pi) for every light, so M / alpha -> albedo / 4."""
    camera = Camera.around(blob_frame.grid, width_px=32, height_px=32)
    thin = Medium(extinction_per_m=0.01, albedo=0.6)
    maps = tracer(device, thin).trace(blob_frame, camera, seed=0)
    seen = maps["alpha"] > 1e-5
    for name in DIRECTIONS:
        np.testing.assert_allclose(maps[name][seen] / maps["alpha"][seen], 0.15, rtol=0.01)


def test_mirrored_smoke_swaps_left_and_right(blob_frame: DensityFrame, device: str) -> None:
    camera = Camera.around(blob_frame.grid, width_px=32, height_px=32)
    mirrored = replace(blob_frame, density=np.ascontiguousarray(blob_frame.density[:, :, ::-1]))
    trace = tracer(device, samples=64)
    maps, swapped = (trace.trace(frame, camera, seed=0) for frame in (blob_frame, mirrored))
    for name in DIRECTIONS:
        other = swapped[FLIP_HORIZONTAL.get(name, name)][:, ::-1]
        np.testing.assert_allclose(maps[name], other, rtol=0.03, atol=0.002, err_msg=name)


def test_a_quarter_turn_of_the_smoke_turns_the_maps(blob_frame: DensityFrame, device: str) -> None:
    camera = Camera.around(blob_frame.grid, kind="orthographic", width_px=32, height_px=32)
    turned = replace(blob_frame, density=np.ascontiguousarray(np.rot90(blob_frame.density, axes=(2, 1))))  # +x to +y
    trace = tracer(device, bounces="single")
    maps, after = (trace.trace(frame, camera, seed=0) for frame in (blob_frame, turned))
    moves = {"right": "top", "top": "left", "left": "bottom", "bottom": "right", "front": "front", "back": "back"}
    for name, moved in moves.items():
        np.testing.assert_allclose(np.rot90(maps[name]), after[moved], rtol=0.01, atol=5e-4, err_msg=name)


@pytest.mark.parametrize("yaw_deg", [0.0, 100.0])
def test_each_light_shines_on_its_own_side(device: str, yaw_deg: float) -> None:
    n = 24
    centres = (np.arange(n) + 0.5) / n - 0.5
    ball = (centres[:, None, None] ** 2 + centres[None, :, None] ** 2 + centres**2 < 0.16).astype(np.float32)
    frame = DensityFrame(density=ball, grid=Grid.centred((n, n, n)))
    camera = Camera.around(frame.grid, yaw_deg=yaw_deg, pitch_deg=15.0, width_px=32, height_px=32)
    maps = tracer(device).trace(frame, camera, seed=0)
    right, top = np.s_[:, 16:], np.s_[:16]
    for name, side in (("right", right), ("top", top)):
        assert maps[name][side].sum() > 0.7 * maps[name].sum()
    for name, side in (("left", right), ("bottom", top)):
        assert maps[name][side].sum() < 0.3 * maps[name].sum()
    assert maps["front"][16, 16] > 4 * maps["back"][16, 16]


@pytest.mark.parametrize("method", ["cached", "path", "stock"])
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize(("yaw_deg", "pitch_deg"), [(0.0, 0.0), (70.0, 30.0), (-160.0, -40.0)])
def test_one_bright_voxel_lies_on_its_camera_ray(
    device: str, method: str, kind: str, yaw_deg: float, pitch_deg: float
) -> None:
    grid = Grid(shape_zyx=(12, 16, 20), voxel_size_m=0.1, origin_m=(3.0, -1.0, 0.5))
    density = np.zeros(grid.shape_zyx, np.float32)
    density[9, 4, 17] = 1.0
    voxel_m = np.array(grid.origin_m) + (np.array([17, 4, 9]) + 0.5) * grid.voxel_size_m
    camera = Camera.around(grid, kind=kind, yaw_deg=yaw_deg, pitch_deg=pitch_deg, width_px=60, height_px=40)
    trace = tracer(device, Medium(extinction_per_m=5.0), method=method, bounces="single", samples=64)
    front = trace.trace(DensityFrame(density=density, grid=grid), camera, seed=0)["front"]
    rows, columns = np.indices(front.shape)
    row, column = (np.average(index, weights=front) for index in (rows, columns))
    origins, rays = camera.rays()
    miss = np.linalg.norm(np.cross(voxel_m - origins, rays), axis=-1)
    nearest = np.unravel_index(miss.argmin(), miss.shape)
    assert abs(row - nearest[0]) < 0.75 and abs(column - nearest[1]) < 0.75


@pytest.mark.parametrize(("method", "samples"), [("cached", 8), ("path", 4096)])
def test_an_obstacle_hides_smoke_and_casts_no_shadow(
    blob_frame: DensityFrame, device: str, method: str, samples: int
) -> None:
    camera = Camera.around(blob_frame.grid, kind="orthographic", width_px=32, height_px=32)
    n = blob_frame.grid.shape_zyx[0]
    wall = np.zeros_like(blob_frame.density)
    wall[n - 2, :, n // 2 :] = 1.0  # before the right half, towards the viewer at +z
    trace = tracer(device, method=method, samples=samples)
    free = trace.trace(blob_frame, camera, seed=0)
    hidden = trace.trace(replace(blob_frame, obstacle=wall), camera, seed=0)
    half_extent_px = 16 / math.sqrt(3.0)
    behind = np.s_[:, 17 : int(16 + half_extent_px)]
    assert hidden.image[behind].max() < 0.01 * free.image[behind].max()
    tolerance = {"rtol": 0.02, "atol": 1e-3 if method == "cached" else 0.02}  # 0.02 is the noise of the paths
    np.testing.assert_allclose(hidden.image[:, :15], free.image[:, :15], **tolerance)
    with pytest.raises(ValueError, match="use method 'cached'"):
        tracer(device, method="stock").trace(replace(blob_frame, obstacle=wall), camera, seed=0)


def test_no_smoke_is_black(device: str) -> None:
    grid = Grid.centred((8, 8, 8))
    frame = DensityFrame(density=np.zeros(grid.shape_zyx, np.float32), grid=grid)
    camera = Camera.around(grid, width_px=12, height_px=8)
    assert not tracer(device).trace(frame, camera, seed=0).image.any()
    assert not tracer(device, method="stock", samples=1).trace(frame, camera, seed=0).image.any()


def test_a_seed_repeats_and_another_differs_little(blob_frame: DensityFrame, device: str) -> None:
    camera = Camera.around(blob_frame.grid, width_px=32, height_px=32)
    first, again, other = (trace_lightmaps(blob_frame, camera, SMOKE, seed=seed).image for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    noise = np.sqrt(np.mean((first - other) ** 2) / 2) / first.mean()
    assert 0.0 < noise < 0.02


def test_strongly_anisotropic_smoke_with_all_bounces_asks_for_path(device: str) -> None:
    with pytest.raises(ValueError, match="use method 'path'"):
        tracer(device, Medium(extinction_per_m=1.0, hg_g=0.6), bounces="multi")


def test_stock_refuses_a_camera_inside_the_volume(blob_frame: DensityFrame, device: str) -> None:
    camera = replace(Camera.around(blob_frame.grid, width_px=8, height_px=8), distance_m=0.1)
    with pytest.raises(ValueError, match="stands inside"):
        tracer(device, method="stock", samples=1).trace(blob_frame, camera, seed=0)
