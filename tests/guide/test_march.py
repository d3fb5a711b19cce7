"""The guide against its oracle, closed forms and symmetries."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.guide import oracle
from sixway.guide.march import GuideConfig, GuideMarcher, to_light_in_world
from sixway.guide.motion import project_motion

ALL_LIGHTS = ("right", "left", "top", "bottom", "front", "back")


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
    in_scatter, transmittance, depth_m = oracle.march_guide(frame, camera, medium, config, seed=5)
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
    in_scatter, transmittance, _ = oracle.march_guide(frame, camera, medium, config, seed=5)
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
    in_scatter, transmittance, _ = oracle.march_guide(frame, camera, medium, config, seed=5)
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


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_projected_motion_follows_a_uniform_wind(device, kind) -> None:
    n = 16
    wind = np.zeros((8, 8, 8, 3), np.float32)
    wind[...] = (0.2, -0.1, 0.0)
    density = np.zeros((n, n, n), np.float32)
    density[7:9, 4:12, 4:12] = 1.0
    frame = DensityFrame(density=density, grid=Grid.centred((n, n, n)), velocity_m_s=wind)
    camera = Camera.around(frame.grid, kind=kind, width_px=40, height_px=40)
    flow = project_motion(frame, camera, Medium(extinction_per_m=50.0), frame_s=0.5, device=device)
    px_per_m = 40 / (2.0 * camera.half_height_m)
    centre = flow[18:22, 18:22].mean((0, 1))
    np.testing.assert_allclose(centre, [0.1 * px_per_m, 0.05 * px_per_m], rtol=0.03)
    assert (flow[0, 0] == 0.0).all()
