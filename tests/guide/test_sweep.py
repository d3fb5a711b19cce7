"""The swept guide against its oracle, closed forms, symmetries and the march."""

import itertools

import numpy as np
import pytest
import warp as wp
from scipy.ndimage import gaussian_filter, maximum_filter

from sixway.bands import RowBands
from sixway.core.config import ConfigError, parse_config
from sixway.core.conventions import OPPOSITE
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, GuideMap, Medium
from sixway.guide import march_oracle, oracle, sweep_oracle
from sixway.guide.config import GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.guide.smoke import block_distances, block_peaks
from sixway.guide.sweep import SHARES, WAYS, turned

ALL_LIGHTS = ("right", "left", "top", "bottom", "front", "back")
SWEEP = GuideConfig(lights=ALL_LIGHTS, sum_lights=False, lighting="sweep", light_grid=12, light_samples=6)


def blob(rng: np.random.Generator, shape: tuple[int, int, int] = (16, 20, 18), *, obstacle: bool = False):
    density = gaussian_filter(rng.random(shape), 1.5)
    density = np.maximum(density - np.median(density), 0.0).astype(np.float32)
    density /= density.max()
    density[:, :, :5] = 0.0  # empty air for the rays to skip
    solid = None
    if obstacle:
        solid = np.zeros(shape, np.float32)
        solid[9:, :10, 3:9] = 1.0
    return DensityFrame(density=density, grid=Grid.centred(shape), obstacle=solid)


def uniform_cube(n: int) -> DensityFrame:
    return DensityFrame(density=np.ones((n, n, n), np.float32), grid=Grid.centred((n, n, n)))


def with_options(**options: object) -> GuideConfig:
    return GuideConfig.model_validate({**SWEEP.model_dump(), **options})


def assert_close_to_oracle(guide: GuideMap, expected: march_oracle.Pictures, share: float) -> None:
    in_scatter, transmittance, depth_m, _ = expected
    # a slab that float32 ends a step sooner is lit elsewhere, and an obstacle's face may move: all but a few
    close = np.isclose(guide.image[..., :6], in_scatter, atol=5e-4).all(-1)
    close &= np.isclose(guide["transmittance"], transmittance, atol=2e-4)
    assert close.mean() > share
    assert (np.isfinite(guide.depth_m) == np.isfinite(depth_m)).mean() > 0.99
    both = np.isfinite(guide.depth_m) & np.isfinite(depth_m)
    assert np.isclose(guide.depth_m[both], depth_m[both], atol=1e-4).mean() > 0.99
    assert guide.image[..., :6].max() > 0.05


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("hg_g", [0.0, 0.6])
@pytest.mark.parametrize("obstacle", [False, True])
def test_kernel_equals_oracle(rng, device, kind, hg_g, obstacle) -> None:
    frame = blob(rng, obstacle=obstacle)
    camera = Camera.around(frame.grid, yaw_deg=33.0, pitch_deg=12.0, kind=kind, width_px=19, height_px=13)
    medium = Medium(extinction_per_m=20.0, albedo=0.8, hg_g=hg_g)
    guide = GuideMarcher(SWEEP, medium, device=device).march(frame, camera, seed=5)
    expected = march_oracle.march(frame, camera, medium, SWEEP, seed=5)
    assert_close_to_oracle(guide, expected, 0.96 if obstacle else 0.98)


@pytest.mark.parametrize(
    "options",
    [
        {"mip": 2},
        {"light_grid": 4, "light_samples": 1},  # density is averaged before the cells sample it
        {"light_grid": 40, "light_samples": 40, "jitter": False, "step_voxels": 0.7},
        {"scatter_iterations": 1},
        {"scatter_iterations": 1, "scatter_cells": 1, "light_grid": 8},
        {"scatter_iterations": 2, "scatter_cells": 4, "light_grid": 18},
        {"scatter_iterations": 3, "mip": 2},
        {"vertical": "world_up"},  # the light grid's axes are not orthogonal
    ],
    ids=lambda options: next(iter(options)),
)
def test_options_equal_oracle(rng, device, options) -> None:
    frame = blob(rng)
    config = with_options(**options)
    camera = Camera.around(frame.grid, yaw_deg=33.0, pitch_deg=25.0, width_px=19, height_px=13)
    medium = Medium(extinction_per_m=20.0)
    guide = GuideMarcher(config, medium, device=device).march(frame, camera, seed=5)
    assert_close_to_oracle(guide, march_oracle.march(frame, camera, medium, config, seed=5), 0.98)


def test_homogeneous_cube_has_its_closed_form(device) -> None:
    """Orthographic view of a unit cube, sigma_t = 4: T and the six maps (analytic single scattering)."""
    sigma = 4.0
    frame = uniform_cube(96)  # density fades over the outer half voxel: fine voxels keep that small
    camera = Camera.around(frame.grid, kind="orthographic", width_px=16, height_px=16, margin=4.0)
    config = with_options(light_grid=48, light_samples=24)
    guide = GuideMarcher(config, Medium(extinction_per_m=sigma), device=device).march(frame, camera, seed=0)
    centre = np.s_[7:9, 7:9]
    assert guide["transmittance"][centre].mean() == pytest.approx(np.exp(-sigma), rel=0.03)
    assert guide["front"][centre].mean() == pytest.approx(0.25 * (1 - np.exp(-2 * sigma)) / 2, rel=0.02)
    assert guide["back"][centre].mean() == pytest.approx(0.25 * sigma * np.exp(-sigma), rel=0.03)
    offset = 4.0 * frame.grid.radius_m / 16  # of the pixel centres from the middle, as is the distance to the face
    side = 0.25 * (1 - np.exp(-sigma)) * np.exp(-sigma * 0.5) * np.cosh(sigma * offset)
    for name in ("right", "left", "top", "bottom"):
        assert guide[name][centre].mean() == pytest.approx(side, rel=0.03), name


@pytest.mark.parametrize("lighting", ["march", "sweep"])
def test_no_smoke_is_lost_at_the_faces_of_the_box(device, lighting) -> None:
    """A cube of four voxels, which fades out over half a voxel beyond its faces: T is that of its whole mass."""
    frame = uniform_cube(4)
    camera = Camera.around(frame.grid, kind="orthographic", width_px=16, height_px=16, margin=4.0)
    config = GuideConfig(lights=ALL_LIGHTS, sum_lights=False, lighting=lighting, step_voxels=0.02, jitter=False)
    guide = GuideMarcher(config, Medium(extinction_per_m=3.0), device=device).march(frame, camera, seed=0)
    np.testing.assert_allclose(guide["transmittance"][7:9, 7:9], np.exp(-3.0), rtol=0.02)


def test_light_reaches_smoke_that_fades_out_beyond_the_face_of_the_box(device) -> None:
    """Rays along the top face of a cube of four voxels pass less smoke the higher they are, and so does the light."""
    frame = uniform_cube(4)
    camera = Camera.around(frame.grid, kind="orthographic", width_px=128, height_px=128, margin=4.0)
    config = with_options(light_grid=4, light_samples=96, step_voxels=0.02, jitter=False)
    guide = GuideMarcher(config, Medium(extinction_per_m=2.0), device=device).march(frame, camera, seed=0)
    height_m = (63.5 - np.arange(128)) * 2.0 * camera.half_height_m / 128
    density = np.clip((0.5 * frame.grid.extent_m[1] - height_m) / frame.grid.voxel_size_m + 0.5, 0.0, 1.0)
    fading = (density > 0.1) & (density < 0.9)
    assert fading.sum() >= 3
    tau = 2.0 * frame.grid.extent_m[2] * density[fading]
    np.testing.assert_allclose(guide["back"][fading, 64], 0.25 * tau * np.exp(-tau), rtol=0.03)
    np.testing.assert_allclose(guide["front"][fading, 64], 0.125 * (1.0 - np.exp(-2.0 * tau)), rtol=0.03)


def test_it_is_near_a_fine_march_and_a_finer_grid_nearer(rng, device) -> None:
    frame = blob(rng, (32, 32, 32))
    camera = Camera.around(frame.grid, yaw_deg=30.0, width_px=24, height_px=24)
    medium = Medium(extinction_per_m=15.0)
    fine_config = GuideConfig(lights=ALL_LIGHTS, sum_lights=False, step_voxels=0.5, jitter=False)
    fine = GuideMarcher(fine_config, medium, device=device).march(frame, camera, seed=0).image[..., :6]

    def error(light_grid: int) -> float:
        config = with_options(light_grid=light_grid, light_samples=24)
        lit = GuideMarcher(config, medium, device=device).march(frame, camera, seed=0).image[..., :6]
        return float(np.sqrt(np.mean((lit - fine) ** 2)) / fine.max())

    assert error(32) < 0.01
    assert error(32) < 0.5 * error(8)


def test_scattered_light_deep_in_an_even_slab_has_its_closed_form() -> None:
    """Light from one side, weakened as e^-tau; 16 optical depths wide, so that only this side's face counts."""
    albedo, number, edge = 0.6, 41, 0.4
    thickness = np.full((number,) * 3, edge)
    tau = edge * (np.arange(number) + 0.5)
    direct = np.zeros((number, number, number, 6))
    direct[..., 1] = np.exp(-tau)  # the light on the left shines up the first axis
    fluence = sweep_oracle.scatter(direct, thickness, albedo=albedo, iterations=1)[20, 20, 20, 1]
    # the transfer equation in a half space, way by way (Chandrasekhar 1960, section 7), with mu along the light
    expected = 0.0
    for way, share in zip(*sweep_oracle.ways(), strict=True):
        mu = way[0] / np.linalg.norm(way)
        gathered = (
            tau[20] if mu == 1.0 else (1.0 - np.exp(tau[20] - tau[20] / mu) * (mu > 0)) / (1.0 - mu) if mu else 1.0
        )
        expected += share * albedo * np.exp(-tau[20]) * gathered
    assert fluence == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("hg_g", [-0.4, 0.6])
@pytest.mark.parametrize("iterations", [1, 3])
def test_light_that_scatters_onwards_equals_the_oracle(rng, device, hg_g, iterations) -> None:
    frame, config = blob(rng), with_options(scatter_iterations=iterations)
    camera = Camera.around(frame.grid, yaw_deg=33.0, pitch_deg=25.0, width_px=19, height_px=13)
    medium = Medium(extinction_per_m=20.0, albedo=0.9, hg_g=hg_g)
    guide = GuideMarcher(config, medium, device=device).march(frame, camera, seed=5)
    assert_close_to_oracle(guide, march_oracle.march(frame, camera, medium, config, seed=5), 0.98)


@pytest.mark.parametrize("hg_g", [-0.8, 0.0, 1e-4, 0.3, 0.9])
def test_what_turns_into_the_ways_is_the_phase_function(hg_g) -> None:
    """Light is conserved, its mean cosine is g as far as rings can tell, and the kernel's parts are the oracle's."""
    parts = [
        (SHARES[np.abs(way).sum()], sign * way[0] / np.linalg.norm(way)) for way in np.array(WAYS) for sign in (-1, 1)
    ]
    assert sum(share for share, _ in parts) == pytest.approx(1.0, abs=1e-12)
    assert sum(share * turned(cosine, hg_g) for share, cosine in parts) == pytest.approx(1.0, abs=1e-9)
    assert sum(share * cosine * turned(cosine, hg_g) for share, cosine in parts) == pytest.approx(hg_g, abs=0.05)
    for cosine in (1.0, 0.5**0.5, 3.0**-0.5, 0.0, -(3.0**-0.5), -(0.5**0.5), -1.0):
        assert turned(cosine, hg_g) == pytest.approx(sweep_oracle.turned(cosine, hg_g), rel=1e-3)


@pytest.mark.parametrize("light_grid", [16, 32])
def test_light_stays_where_it_is_while_smoke_grows_elsewhere(rng, device, light_grid) -> None:
    """Smoke that appears far below, voxel by voxel, changes no light above but that from below."""
    full = blob(rng, (32, 32, 32)).density
    config = with_options(light_grid=light_grid, jitter=False, vertical="world_up")
    marcher = GuideMarcher(config, Medium(extinction_per_m=15.0), device=device)
    grid = Grid.centred((32, 32, 32))
    camera = Camera.around(grid, yaw_deg=30.0, kind="orthographic", width_px=24, height_px=24)
    height = np.arange(32)[None, :, None]
    images = []
    for bottom in (8, 7, 6, 5, 4, 3):
        density = np.where((height >= 18) | (height < 10) & (height >= bottom), full, 0.0).astype(np.float32)
        images.append(marcher.march(DensityFrame(density=density, grid=grid), camera, seed=0))
    above = np.s_[:10]  # pixels whose rays pass the upper smoke alone
    for name in ("right", "left", "top", "front", "back"):
        changes = [
            np.abs(after[name][above] - before[name][above]).max() for before, after in itertools.pairwise(images)
        ]
        assert images[0][name][above].max() > 0.05
        assert max(changes) < 1e-5, name


@pytest.mark.parametrize("hg_g", [0.0, 0.5])
def test_with_one_scattering_it_comes_near_the_reference_with_one_bounce(rng, device, hg_g) -> None:
    """Light that has scattered once or twice in white smoke: every map's mean, and its error far below without."""
    from sixway.reference.lightmaps import trace_lightmaps

    density = np.ascontiguousarray(blob(rng, (24, 24, 24)).density[:, :, 4:])  # smoke up to the faces of the box
    frame = DensityFrame(density=density, grid=Grid.centred(density.shape))
    camera = Camera.around(frame.grid, yaw_deg=30.0, width_px=20, height_px=20)
    medium = Medium(extinction_per_m=12.0, hg_g=hg_g)
    truth = trace_lightmaps(frame, camera, medium, bounces="paper", samples=8).maps

    def lit(iterations: int) -> np.ndarray:
        config = with_options(light_grid=48, light_samples=24, scatter_iterations=iterations, pixel_samples=4)
        return GuideMarcher(config, medium, device=device).march(frame, camera, seed=0).image[..., :6]

    np.testing.assert_allclose(lit(1).mean((0, 1)), truth.mean((0, 1)), rtol=0.02 if hg_g == 0.0 else 0.06)
    assert np.mean((lit(1) - truth) ** 2) < (0.05 if hg_g == 0.0 else 0.1) * np.mean((lit(0) - truth) ** 2)


def test_a_volume_of_even_symmetry_swaps_opposite_lights(rng, device) -> None:
    """Seen from behind through a half turn about y, right and left, front and back change places."""
    density = blob(rng, (18, 18, 18)).density
    density = np.ascontiguousarray(density + density[::-1, :, ::-1])  # its own half turn about y
    frame = DensityFrame(density=density, grid=Grid.centred(density.shape))
    medium = Medium(extinction_per_m=8.0)
    config = with_options(jitter=False)
    marcher = GuideMarcher(config, medium, device=device)
    near, far = (
        marcher.march(frame, Camera.around(frame.grid, yaw_deg=yaw, width_px=16, height_px=16), seed=0).image
        for yaw in (25.0, 205.0)
    )
    np.testing.assert_allclose(near, far, atol=1e-3)

    mirrored = density + density[:, :, ::-1]
    frame = DensityFrame(density=np.ascontiguousarray(mirrored), grid=Grid.centred(density.shape))
    guide = marcher.march(frame, Camera.around(frame.grid, width_px=16, height_px=16), seed=0)
    for name in ("right", "left"):
        np.testing.assert_allclose(guide[name], guide[OPPOSITE[name]][:, ::-1], atol=1e-3)


def test_summed_and_chosen_lights_are_those_of_all_six(rng, device) -> None:
    frame = blob(rng)
    camera = Camera.around(frame.grid, width_px=16, height_px=16)
    medium = Medium(extinction_per_m=10.0)
    all_six = GuideMarcher(SWEEP, medium, device=device).march(frame, camera, seed=3)
    paper = with_options(lights=("front", "top", "bottom"), sum_lights=True)
    guide = GuideMarcher(paper, medium, device=device).march(frame, camera, seed=3)
    assert guide.channels == ("in_scatter", "transmittance", "depth")
    total = all_six["front"] + all_six["top"] + all_six["bottom"]
    np.testing.assert_allclose(guide["in_scatter"], total, rtol=1e-6)


def test_equal_seeds_give_equal_bytes_with_any_number_of_threads(rng, device) -> None:
    frame = blob(rng)
    camera = Camera.around(frame.grid, width_px=33, height_px=29)
    medium = Medium(extinction_per_m=10.0)
    one, three, other = (
        GuideMarcher(with_options(mip=2), medium, device=device, threads=threads).march(frame, camera, seed=seed).image
        for threads, seed in ((1, 1), (3, 1), (1, 2))
    )
    assert one.tobytes() == three.tobytes()
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("edge", [4, 8])
def test_rays_skip_nothing_but_empty_air(rng, device, edge) -> None:
    density = np.zeros((21, 17, 70), np.float32)
    density[rng.integers(21, size=6), rng.integers(17, size=6), rng.integers(10, size=6)] = 1.0
    on_device = wp.get_device(device)
    field = wp.array(density, dtype=float, device=on_device)
    peaks = block_peaks(field, edge, device=on_device, bands=RowBands(on_device, threads=1))
    np.testing.assert_array_equal(peaks, oracle.block_peaks(density, edge))
    reach = maximum_filter(density, size=3) > 0.5  # interpolation reaches one voxel beyond a block
    full = np.zeros(peaks.shape, bool)
    for k, j, i in np.argwhere(reach):
        full[k // edge, j // edge, i // edge] = True
    assert ((peaks > 0.5) == full).all()
    distances = block_distances(full)
    assert (distances[full] == 0).all()
    for k, j, i in np.argwhere(~full):
        way = np.abs(np.argwhere(full) - (k, j, i)).max(axis=1).min()
        assert distances[k, j, i] == min(way, 8)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lighting": "march", "light_grid": 48}, "lighting march does not read light_grid"),
        ({"lighting": "sweep", "weight": "paper_literal"}, "lighting sweep does not read weight"),
        ({"lighting": "sweep", "steps_per_edge": 64}, "lighting sweep does not read steps_per_edge"),
        ({"mip": 3}, "mip"),
    ],
)
def test_options_that_would_do_nothing_are_errors(options, message) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_config(GuideConfig, options, source="test")


def test_axes_in_one_plane_are_an_error(rng) -> None:
    frame = blob(rng)
    camera = Camera.around(frame.grid, yaw_deg=0.0, pitch_deg=20.0)
    marcher = GuideMarcher(with_options(vertical="omega_cross_z"), Medium(extinction_per_m=10.0), device="cpu")
    with pytest.raises(ValueError, match="nearly in one plane"):
        marcher.march(frame, camera, seed=0)


def test_smoke_too_thin_to_see_leaves_the_picture_empty(device) -> None:
    frame = DensityFrame(density=np.full((8, 8, 8), 1e-9, np.float32), grid=Grid.centred((8, 8, 8)))
    camera = Camera.around(frame.grid, width_px=8, height_px=8)
    guide = GuideMarcher(SWEEP, Medium(extinction_per_m=10.0), device=device).march(frame, camera, seed=1)
    assert (guide["transmittance"] == 1.0).all() and (guide.image[..., :6] == 0.0).all()
    assert (guide["depth"] == 0.0).all() and np.isinf(guide.depth_m).all()
