"""Discs, winds, puffs and gusts, and where they stand."""

import numpy as np
import pytest
import warp as wp

from sixway.core.frames import Grid
from sixway.sim.gusts import Gusts, blow
from sixway.sim.placement import SmokeSources, first_wind, imposed_cells, voxel_centres
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.sources import InletConfig, PuffConfig, WindConfig

DISC = InletConfig(centre_m=(0.0, -0.5, 0.0), radius_m=0.2, speed_m_s=2.0)


def test_gusts_stand_across_their_waves_and_have_the_asked_strength(rng: np.random.Generator) -> None:
    gusts = Gusts.draw(rng, radius=4.0, speed=0.1, turbulence=0.3)
    np.testing.assert_allclose(np.sum(gusts.wave * gusts.amplitude, axis=1), 0.0, atol=1e-12)
    u = gusts.at(rng.uniform(0.0, 10_000.0, (20_000, 3)), time=3.0)
    assert np.sqrt(np.mean(np.sum(u**2, axis=1))) == pytest.approx(0.03, rel=0.02)


def test_the_kernel_blows_what_the_float64_twin_says(rng: np.random.Generator, device: str) -> None:
    gusts = [Gusts.draw(rng, radius=3.0, speed=0.1, turbulence=0.4) for _ in range(2)]
    cell = rng.integers(0, 9, (40, 3))
    cell = np.unique(cell, axis=0)
    source = rng.integers(0, 2, len(cell))
    mean = rng.normal(0.0, 0.1, (len(cell), 3))
    imposed = wp.zeros((9, 9, 9), dtype=wp.vec3, device=device)
    arrays = [(cell.astype(np.int32), wp.vec3i), (source.astype(np.int32), wp.int32), (mean, wp.vec3)]
    arrays += [(np.stack([getattr(g, name) for g in gusts]), wp.vec3) for name in ("wave", "amplitude")]
    arrays += [(np.stack([getattr(g, name) for g in gusts]), wp.float32) for name in ("frequency", "phase")]
    inputs = [wp.array(values, dtype=kind, device=device) for values, kind in arrays]
    wp.launch(blow, dim=len(cell), inputs=[*inputs, 17.0, imposed], device=device)
    wanted = np.stack([m + gusts[s].at(c[None], time=17.0)[0] for m, s, c in zip(mean, source, cell, strict=True)])
    np.testing.assert_allclose(imposed.numpy()[cell[:, 2], cell[:, 1], cell[:, 0]], wanted, atol=2e-6)


@pytest.mark.parametrize("profile", ["plug", "parabolic"])
def test_a_disc_passes_the_asked_flux_and_turns(profile: str) -> None:
    disc = DISC.model_copy(update={"profile": profile, "swirl": 0.5})
    points = voxel_centres(Grid.centred((200, 200, 200)))[:, 0, :, :].reshape(-1, 3)
    inside = disc.covers(points, half_thickness_m=0.01)
    u = disc.mean_velocity(points[inside])
    assert u[:, 1].mean() == pytest.approx(2.0, rel=0.01)
    rightmost = np.argmax(points[inside][:, 0])
    assert u[rightmost, 2] == pytest.approx(-0.5 * 2.0, rel=0.03)  # counter-clockwise seen from above
    assert np.linalg.norm(u, axis=1).max() <= disc.peak_m_s


def test_wind_grows_with_height() -> None:
    wind = WindConfig(face="x_high", speed_m_s=3.0, shear=0.25)
    points = np.array([[0.0, -1.0, 0.0], [0.0, -1.0 + 2.0 / 16.0, 0.0], [0.0, 1.0, 0.0]])
    u = wind.mean_velocity(points, floor_m=-1.0, height_m=2.0)
    np.testing.assert_allclose(u, [[0.0, 0.0, 0.0], [-1.5, 0.0, 0.0], [-3.0, 0.0, 0.0]])


def scenario(**changes: object) -> ScenarioConfig:
    fields: dict = {"name": "test", "resolution": {"cells": 16, "refinement": 2}, **changes}
    return ScenarioConfig.model_validate({"inlets": (DISC.model_dump(),), **fields}, strict=False)


def test_a_wind_fills_its_side_and_the_box() -> None:
    config = scenario(
        winds=[{"face": "x_low", "speed_m_s": 1.0, "turbulence": 0.0}],
        inlets=[{**DISC.model_dump(), "turbulence": 0.0}],
        flow={"faces": {"x_high": "open", "y_high": "open"}},
    )
    imposed = imposed_cells(config)
    side = imposed.source == 0
    assert side.sum() == 16 * 16
    assert set(imposed.cell[side][:, 0]) == {0}
    np.testing.assert_allclose(imposed.mean[side], [[0.05, 0.0, 0.0]] * 256, atol=1e-12)
    disc = imposed.cell[~side]
    assert set(disc[:, 1]) == {1}  # one layer on the floor, inside the shell
    np.testing.assert_allclose(first_wind(config)[..., 0], 0.05)


def test_puffs_come_and_go() -> None:
    puff = {"centre_m": (0.0, 0.0, 0.0), "radius_m": 0.2, "roughness": 0.0, "density": 0.7}
    config = scenario(puffs=[puff, {**puff, "start_s": 0.3, "duration_s": 0.2, "centre_m": (0.2, 0.2, 0.0)}])
    sources = SmokeSources(config)
    assert sources.active(since_s=0.0, until_s=0.1) == (0,)
    assert sources.active(since_s=0.1, until_s=0.3) == ()
    assert sources.active(since_s=0.25, until_s=0.35) == (1,)
    assert sources.active(since_s=0.45, until_s=0.55) == (1,)
    assert sources.active(since_s=0.55, until_s=0.65) == ()
    only_inlet, both = sources.fields(())["density"], sources.fields((0,))["density"]
    volume = (both == np.float32(0.7)).sum() / both.size
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * 0.2**3, rel=0.05)
    assert 0 < (only_inlet > 0).sum() < (both > 0).sum()


def test_a_rough_puff_keeps_about_its_size_and_its_seed(rng: np.random.Generator) -> None:
    puff = PuffConfig(centre_m=(0.0, 0.0, 0.0), radius_m=0.25, roughness=0.4)
    points = voxel_centres(Grid.centred((48, 48, 48)))
    one, again, other = (puff.covers(points, seed=(seed,)) for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert (one != other).any()
    assert one.mean() == pytest.approx(4.0 / 3.0 * np.pi * 0.25**3, rel=0.8)
