"""The guide against its oracle, closed forms and symmetries."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from sixway.core.config import ConfigError, parse_config
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.guide import march_oracle, smoke_kernels
from sixway.guide.config import LIGHT_SETS, GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.guide.views import to_light_in_world

ALL_LIGHTS = ("right", "left", "top", "bottom", "front", "back")
BOTH = [{"lighting": "march"}, {"lighting": "sweep", "light_grid": 12, "scatter_iterations": 1}]


def blob(rng: np.random.Generator, n: int = 16, *, obstacle: bool = False) -> DensityFrame:
    density = gaussian_filter(rng.random((n, n, n)), 1.5)
    density = np.maximum(density - np.median(density), 0.0).astype(np.float32)
    density /= density.max()
    solid = None
    if obstacle:
        solid = np.zeros((n, n, n), np.float32)
        solid[:, : n // 2, n // 3 : n // 2] = 1.0
    return DensityFrame(density=density, grid=Grid.centred((n, n, n)), obstacle=solid)


def uniform_cube(n: int = 32) -> DensityFrame:
    return DensityFrame(density=np.ones((n, n, n), np.float32), grid=Grid.centred((n, n, n)))


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("hg_g", [0.0, 0.6])
@pytest.mark.parametrize("obstacle", [False, True])
def test_kernel_equals_oracle(rng, device, kind, hg_g, obstacle) -> None:
    frame = blob(rng, obstacle=obstacle)
    camera = Camera.around(frame.grid, yaw_deg=33.0, pitch_deg=12.0, kind=kind, width_px=19, height_px=13)
    medium = Medium(extinction_per_m=20.0, albedo=0.8, hg_g=hg_g)
    config = GuideConfig(lights=ALL_LIGHTS, sum_lights=False)
    guide = GuideMarcher(config, medium, device=device).march(frame, camera, seed=5)
    in_scatter, transmittance, depth_m, _ = march_oracle.march(frame, camera, medium, config, seed=5)
    lit = guide.image[..., :6]
    # a sample that float32 puts across a voxel's or obstacle's face may differ: compare all but a few
    close = np.isclose(lit, in_scatter, atol=2e-4).all(-1) & np.isclose(
        guide["transmittance"], transmittance, atol=2e-4
    )
    assert close.mean() > (0.97 if obstacle else 0.999)
    both = np.isfinite(guide.depth_m) & np.isfinite(depth_m)
    assert np.isclose(guide.depth_m[both], depth_m[both], atol=1e-4).mean() > 0.99
    assert lit.max() > 0.05


@pytest.mark.parametrize("mip", [2, 4])
def test_a_mip_equals_the_oracle_where_its_boxes_do_not_fit_the_grid(rng, device, mip) -> None:
    frame = blob(rng, 18, obstacle=True)
    camera = Camera.around(frame.grid, yaw_deg=-50.0, pitch_deg=30.0, width_px=17, height_px=14)
    medium = Medium(extinction_per_m=20.0)
    config = GuideConfig(lights=ALL_LIGHTS, sum_lights=False, mip=mip, steps_per_edge=24)
    guide = GuideMarcher(config, medium, device=device).march(frame, camera, seed=5)
    in_scatter, transmittance, _, _ = march_oracle.march(frame, camera, medium, config, seed=5)
    close = np.isclose(guide.image[..., :6], in_scatter, atol=2e-4).all(-1)
    close &= np.isclose(guide["transmittance"], transmittance, atol=2e-4)
    assert close.mean() > 0.97


def test_smoke_in_a_corner_behind_a_wall_elsewhere(rng, device) -> None:
    """Rays start where smoke or walls do: neither a wall in empty air nor the march's sample positions get lost."""
    frame = blob(rng, 16)
    density, wall = frame.density.copy(), np.zeros((16, 16, 16), np.float32)
    density[:, :, :9] = 0.0
    density[6:] = 0.0
    wall[12:14, 6:12, 6:14] = 1.0
    frame = DensityFrame(density=density, grid=frame.grid, obstacle=wall)
    camera = Camera.around(frame.grid, yaw_deg=10.0, width_px=23, height_px=23)
    medium, config = Medium(extinction_per_m=20.0), GuideConfig(lights=ALL_LIGHTS, sum_lights=False)
    guide = GuideMarcher(config, medium, device=device).march(frame, camera, seed=5)
    in_scatter, transmittance, _, _ = march_oracle.march(frame, camera, medium, config, seed=5)
    close = np.isclose(guide.image[..., :6], in_scatter, atol=2e-4).all(-1)
    close &= np.isclose(guide["transmittance"], transmittance, atol=2e-4)
    assert close.mean() > 0.97
    open_air = DensityFrame(density=density, grid=frame.grid)
    unhidden = GuideMarcher(config, medium, device=device).march(open_air, camera, seed=5)
    assert (guide["transmittance"] > unhidden["transmittance"] + 0.1).sum() > 5


def test_homogeneous_cube_has_its_closed_form(device) -> None:
    """Orthographic view of a unit cube, sigma_t = 4: T and the six maps (analytic single scattering)."""
    sigma = 4.0
    frame = uniform_cube(128)  # density fades over the outer half voxel: fine voxels keep that small
    camera = Camera.around(frame.grid, kind="orthographic", width_px=16, height_px=16, margin=4.0)
    config = GuideConfig(lights=ALL_LIGHTS, sum_lights=False, steps_per_edge=256, jitter=False)
    guide = GuideMarcher(config, Medium(extinction_per_m=sigma), device=device).march(frame, camera, seed=0)
    centre = np.s_[7:9, 7:9]
    assert guide["transmittance"][centre].mean() == pytest.approx(np.exp(-sigma), rel=0.03)
    assert guide["front"][centre].mean() == pytest.approx(0.25 * (1 - np.exp(-2 * sigma)) / 2, rel=0.02)
    assert guide["back"][centre].mean() == pytest.approx(0.25 * sigma * np.exp(-sigma), rel=0.03)
    offset = 4.0 * frame.grid.radius_m / 16  # of the pixel centres from the middle, as is the distance to the face
    side = 0.25 * (1 - np.exp(-sigma)) * np.exp(-sigma * 0.5) * np.cosh(sigma * offset)
    for name in ("right", "left", "top", "bottom"):
        assert guide[name][centre].mean() == pytest.approx(side, rel=0.03), name


def test_a_light_brightens_its_own_side(device) -> None:
    frame = uniform_cube(16)
    camera = Camera.around(frame.grid, yaw_deg=20.0, width_px=32, height_px=32)
    config = GuideConfig(lights=ALL_LIGHTS, sum_lights=False)
    guide = GuideMarcher(config, Medium(extinction_per_m=8.0), device=device).march(frame, camera, seed=0)
    assert guide["right"][:, 16:].sum() > 2.0 * guide["right"][:, :16].sum()
    assert guide["left"][:, :16].sum() > 2.0 * guide["left"][:, 16:].sum()
    assert guide["top"][:16].sum() > 2.0 * guide["top"][16:].sum()
    assert guide["front"].sum() > 2.0 * guide["back"].sum()


def test_the_papers_guide_is_the_sum_of_its_three_lights(rng, device) -> None:
    frame = blob(rng)
    camera = Camera.around(frame.grid, width_px=16, height_px=16)
    medium = Medium(extinction_per_m=10.0)
    paper = GuideMarcher(GuideConfig(), medium, device=device).march(frame, camera, seed=3)
    apart = GuideMarcher(GuideConfig(sum_lights=False), medium, device=device).march(frame, camera, seed=3)
    assert paper.channels == ("in_scatter", "transmittance", "depth")
    assert apart.channels == ("top", "bottom", "front", "transmittance", "depth")
    np.testing.assert_allclose(paper["in_scatter"], apart.image[..., :3].sum(-1), rtol=1e-6)


def test_equal_seeds_give_equal_bytes_and_other_seeds_do_not(rng, device) -> None:
    frame = blob(rng)
    camera = Camera.around(frame.grid, width_px=16, height_px=16)
    marcher = GuideMarcher(GuideConfig(), Medium(extinction_per_m=10.0), device=device)
    first, again, other = (marcher.march(frame, camera, seed=s).image for s in (1, 1, 2))
    assert first.tobytes() == again.tobytes()
    assert not np.array_equal(first, other)


def test_threads_change_no_byte(rng, device) -> None:
    frame = blob(rng)
    camera = Camera.around(frame.grid, width_px=33, height_px=29)
    medium = Medium(extinction_per_m=10.0)
    alone, together = (
        GuideMarcher(GuideConfig(), medium, device=device, threads=n).march(frame, camera, seed=1) for n in (1, 3)
    )
    assert alone.image.tobytes() == together.image.tobytes()


def test_empty_air_is_transparent_and_has_no_depth(device) -> None:
    frame = DensityFrame(density=np.zeros((8, 8, 8), np.float32), grid=Grid.centred((8, 8, 8)))
    camera = Camera.around(frame.grid, width_px=8, height_px=8)
    guide = GuideMarcher(GuideConfig(), Medium(extinction_per_m=10.0), device=device).march(frame, camera, seed=1)
    assert (guide["transmittance"] == 1.0).all()
    assert (guide["depth"] == 0.0).all()
    assert np.isinf(guide.depth_m).all()


def test_depth_tells_near_from_far(device) -> None:
    density = np.zeros((16, 16, 16), np.float32)
    density[14, 8, 4] = 50.0  # near the viewer, left
    density[1, 8, 11] = 50.0  # far, right
    frame = DensityFrame(density=density, grid=Grid.centred((16, 16, 16)))
    camera = Camera.around(frame.grid, kind="orthographic", width_px=32, height_px=32)
    config = GuideConfig(steps_per_edge=64, jitter=False)
    guide = GuideMarcher(config, Medium(extinction_per_m=50.0), device=device).march(frame, camera, seed=1)
    left, right = guide["depth"][:, :16], guide["depth"][:, 16:]
    assert 0.0 < left[left > 0].min() < 0.4
    assert 0.6 < right[right > 0].min() <= 1.0


def test_the_printed_weight_differs_as_its_missing_step_length_says(rng, device) -> None:
    """T sigma instead of T (1 - exp(-sigma h)): larger by about 1 / h in thin smoke."""
    frame = blob(rng)
    camera = Camera.around(frame.grid, width_px=16, height_px=16)
    thin = Medium(extinction_per_m=0.5)
    exact = GuideMarcher(GuideConfig(), thin, device=device).march(frame, camera, seed=3)
    printed = GuideMarcher(GuideConfig(weight="paper_literal"), thin, device=device).march(frame, camera, seed=3)
    lit = exact["in_scatter"] > 1e-6
    ratio = printed["in_scatter"][lit] / exact["in_scatter"][lit]
    np.testing.assert_allclose(np.median(ratio), 40.0, rtol=0.02)


def test_a_degenerate_vertical_is_an_error() -> None:
    camera = Camera.around(Grid.centred((4, 4, 4)), yaw_deg=0.0)
    with pytest.raises(ValueError, match="omega_cross_z is undefined"):
        to_light_in_world("top", camera, "omega_cross_z")
    side = Camera.around(Grid.centred((4, 4, 4)), yaw_deg=60.0)
    top = np.array(to_light_in_world("top", side, "omega_cross_z"))
    assert abs(top[1]) == pytest.approx(1.0)
    np.testing.assert_allclose(to_light_in_world("bottom", side, "omega_cross_z"), -top)


def test_a_light_set_goes_by_its_name_and_is_kept_as_its_lights() -> None:
    named, listed = GuideConfig(lights="front_tb"), GuideConfig(lights=("front", "top", "bottom"))
    assert named == listed == GuideConfig()
    assert named.model_dump(mode="json")["lights"] == ["front", "top", "bottom"]
    counts = {name: len(parse_config(GuideConfig, {"lights": name}, source="test").lights) for name in LIGHT_SETS}
    assert counts == {"front": 1, "front_lr": 3, "front_tb": 3, "all": 6}
    assert parse_config(GuideConfig, {"lights": ["front", "top", "bottom"]}, source="test") == named
    with pytest.raises(ConfigError, match=r"lights.*names a light twice"):
        parse_config(GuideConfig, {"lights": ["front", "front"]}, source="test")
    assert GuideConfig(lights="front_lr").light_names == ("right", "left", "front")
    with pytest.raises(ConfigError, match="'sides' is no light set; use front, front_lr"):
        parse_config(GuideConfig, {"lights": "sides"}, source="test")


@pytest.mark.parametrize("options", BOTH, ids=lambda options: options["lighting"])
def test_views_share_a_frame_and_equal_single_marches(rng, device, options) -> None:
    frame, medium = blob(rng), Medium(extinction_per_m=10.0)
    config = GuideConfig(lights="all", sum_lights=False, **options)
    cameras = [Camera.around(frame.grid, yaw_deg=yaw, width_px=12, height_px=16) for yaw in (0.0, 40.0, 80.0)]
    together = GuideMarcher(config, medium, device=device).march_views(frame, cameras, seeds=[3, 4, 5])
    for guide, camera, seed in zip(together, cameras, (3, 4, 5), strict=True):
        alone = GuideMarcher(config, medium, device=device).march(frame, camera, seed=seed)
        assert guide.image.tobytes() == alone.image.tobytes()
    with pytest.raises(ValueError, match="3 cameras and 1 seeds"):
        GuideMarcher(config, medium, device=device).march_views(frame, cameras, seeds=[3])


def test_edges_begin_where_the_oracle_says() -> None:
    assert march_oracle.LARGEST_DIFFERENCE == smoke_kernels.LARGEST_DIFFERENCE


@pytest.mark.parametrize(("options", "rays"), [(BOTH[0], 4), (BOTH[1], 4), (BOTH[1], 16)])
def test_pixels_on_edges_are_the_mean_of_several_rays(rng, device, options, rays) -> None:
    frame, medium = blob(rng, obstacle=True), Medium(extinction_per_m=20.0)
    camera = Camera.around(frame.grid, yaw_deg=33.0, pitch_deg=12.0, width_px=19, height_px=13)
    once, finer = (GuideConfig(lights="all", sum_lights=False, pixel_samples=n, **options) for n in (1, rays))
    guide = GuideMarcher(finer, medium, device=device, threads=2).march(frame, camera, seed=5)
    in_scatter, transmittance, _, _ = march_oracle.march(frame, camera, medium, finer, seed=5)
    close = np.isclose(guide.image[..., :6], in_scatter, atol=5e-4).all(-1)
    close &= np.isclose(guide["transmittance"], transmittance, atol=2e-4)
    assert close.mean() > 0.95
    rough = GuideMarcher(once, medium, device=device).march(frame, camera, seed=5)
    changed = (guide.image != rough.image).any(-1)
    assert 0.1 < changed.mean() < 0.7

    truth_camera = camera.resized(19 * 8, 13 * 8)
    truth = GuideMarcher(once, medium, device=device, threads=2).march(frame, truth_camera, seed=5).image
    truth = truth.reshape(13, 8, 19, 8, -1).mean(axis=(1, 3))[..., :7]
    error, rough_error = (np.mean((image[..., :7] - truth) ** 2) for image in (guide.image, rough.image))
    assert error < (0.5 if rays == 4 else 0.3) * rough_error


def test_small_pixels_get_no_more_rays_than_those_of_the_reference() -> None:
    grid = Grid.centred((20, 20, 20))
    camera = Camera.orthographic(position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), width_px=26, height_px=26)
    sixteen, four = (GuideConfig(pixel_samples=rays) for rays in (16, 4))
    assert sixteen.rays_a_side(camera, grid) == 4  # a pixel is 20 / 26 voxels wide
    assert sixteen.rays_a_side(camera.resized(27, 27), grid) == 2
    assert four.rays_a_side(camera, grid) == four.rays_a_side(camera.resized(27, 27), grid) == 2


def burning(density: float, emission: float, n: int = 32) -> DensityFrame:
    """A cube of even smoke and fire."""
    full = np.ones((n, n, n), np.float32)
    return DensityFrame(density=density * full, emission=emission * full, grid=Grid.centred((n, n, n)))


@pytest.mark.parametrize("lighting", ["march", "sweep"])
@pytest.mark.parametrize("density", [0.0, 1.0])
def test_even_fire_has_its_closed_form(device, lighting, density) -> None:
    """Radiance eps (1 - e^{-sigma}) / sigma through a unit cube; eps without smoke."""
    frame = burning(density, 0.7)
    camera = Camera.around(frame.grid, kind="orthographic", width_px=16, height_px=16, margin=4.0)
    config = GuideConfig(lighting=lighting, step_voxels=0.25, emission=True, jitter=False)
    guide = GuideMarcher(config, Medium(extinction_per_m=2.0), device=device).march(frame, camera, seed=0)
    sigma = 2.0 * density
    expected = 0.7 * (1.0 - np.exp(-sigma)) / sigma if density else 0.7
    assert guide.channels[-1] == "emissive"
    assert guide["emissive"][7:9, 7:9].mean() == pytest.approx(expected, rel=0.02)
    assert guide["emissive"][0, 0] == 0.0


@pytest.mark.parametrize("options", BOTH, ids=lambda options: options["lighting"])
def test_emission_equals_the_oracle_and_needs_no_smoke(rng, device, options) -> None:
    smoke = blob(rng, obstacle=True)
    fire = np.zeros_like(smoke.density)
    fire[3:14, 2:9, 6:15] = gaussian_filter(rng.random((11, 7, 9)), 1.0)
    frame = DensityFrame(density=smoke.density, emission=fire, obstacle=smoke.obstacle, grid=smoke.grid)
    camera = Camera.around(frame.grid, yaw_deg=33.0, pitch_deg=12.0, width_px=19, height_px=13)
    medium = Medium(extinction_per_m=20.0)
    config = GuideConfig(emission=True, mip=2, **options)
    guide = GuideMarcher(config, medium, device=device).march(frame, camera, seed=5)
    emitted = march_oracle.march(frame, camera, medium, config, seed=5)[3]
    assert np.isclose(guide["emissive"], emitted, atol=2e-4).mean() > 0.96
    assert emitted.max() > 0.02

    clear = DensityFrame(density=0.0 * smoke.density, emission=fire, grid=smoke.grid)
    lone = GuideMarcher(config, medium, device=device).march(clear, camera, seed=5)
    assert lone["emissive"].max() > 0.05 and (lone["transmittance"] == 1.0).all()
    dark = GuideMarcher(config, medium, device=device).march(smoke, camera, seed=5)
    assert (dark["emissive"] == 0.0).all()
    np.testing.assert_allclose(dark["transmittance"], guide["transmittance"], atol=1e-5)
