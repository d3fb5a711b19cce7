"""Whole simulations, small."""

from pathlib import Path

import numpy as np
import pytest

from sixway.core.records import DensityFrame
from sixway.sim.checkpoint import load_checkpoint, save_checkpoint
from sixway.sim.placement import voxel_centres
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import FlowError, SmokeSolver

JET = {"centre_m": (0.0, -0.5, 0.0), "radius_m": 0.15, "swirl": 0.5, "turbulence": 0.3}
CYLINDER = {"kind": "cylinder", "axis": "z", "centre_m": (0.05, 0.0, 0.0), "radius_m": 0.15}
SWINGING = {
    "kind": "sphere",
    "centre_m": (0.0, 0.1, 0.0),
    "radius_m": 0.15,
    "motion": {"kind": "rigid", "velocity_m_s": (0.4, 0.0, 0.0), "spin_deg_s": (0.0, 90.0, 0.0)},
}
FIRE = {
    "inlets": ({**JET, "density": 0.0, "temperature_k": 500.0, "fuel": 1.0},),
    "smoke": {"heat_buoyancy_m_s2_k": 0.002, "cooling_per_s": 1.0, "vorticity_confinement": 0.5},
    "burn": {},
}


def scenario(**changes: object) -> ScenarioConfig:
    """A jet in a box of 16^3 cells, just long enough to rise."""
    fields: dict = {"name": "test", "resolution": {"cells": 16, "refinement": 2}, "frames": 3, "warmup_frames": 5}
    return ScenarioConfig.model_validate({**fields, "inlets": (JET,), **changes}, strict=False)


def simulate(config: ScenarioConfig, device: str) -> list[DensityFrame]:
    return list(SmokeSolver(config, device=device).frames())


def test_frames_hold_what_they_promise(device: str) -> None:
    config = scenario(
        box_m=(2.0, 3.0, 1.5),
        resolution={"cells": 24, "refinement": 2},
        inlets=({**JET, "centre_m": (0.0, -1.5, 0.0), "radius_m": 0.5},),
    )
    frames = simulate(config, device)
    assert len(frames) == 3
    frame = frames[-1]
    assert frame.density.shape == (24, 48, 32)
    assert frame.grid == config.density_grid
    assert frame.grid.voxel_size_m == pytest.approx(3.0 / 48)
    assert frame.velocity_m_s is not None and frame.velocity_m_s.shape == (12, 24, 16, 3)
    assert frame.time_s == pytest.approx(8 * 0.05)
    assert 0.5 < frame.velocity_m_s[..., 1].max() < 3.0  # the inlet blows 1 m/s up, gusts included
    assert frame.obstacle is None and frame.emission is None
    assert not np.array_equal(frames[0].density, frame.density)  # frames are copies, not views


def test_smoke_rises(device: str) -> None:
    first, *_, last = simulate(scenario(), device)
    assert height(first) < height(last)
    assert last.density.max() <= 1.0


def height(frame: DensityFrame) -> float:
    """Mean height of the smoke [m]."""
    return float(np.average(voxel_centres(frame.grid)[..., 1], weights=frame.density))


def test_heat_lifts_smoke_and_weight_sinks_it(device: str) -> None:
    puff = {"centre_m": (0.0, 0.0, 0.0), "radius_m": 0.2, "roughness": 0.0}
    base = {"inlets": (), "speed_m_s": 1.0, "warmup_frames": 10, "frames": 1}
    hot = scenario(**base, puffs=({**puff, "temperature_k": 30.0},))
    heavy = scenario(**base, puffs=(puff,), smoke={"buoyancy_m_s2": -1.0})
    still = scenario(**base, puffs=(puff,))
    up, down, stay = (height(simulate(config, device)[-1]) for config in (hot, heavy, still))
    assert up > 0.02 and down < -0.02
    assert abs(stay) < 1e-3


def test_same_seed_same_bytes_other_seed_other_plume(device: str) -> None:
    one, again, other = (simulate(scenario(seed=seed), device)[-1] for seed in (1, 1, 2))
    assert one.density.tobytes() == again.density.tobytes()
    assert one.velocity_m_s is not None and again.velocity_m_s is not None
    assert one.velocity_m_s.tobytes() == again.velocity_m_s.tobytes()
    assert np.abs(one.density - other.density).mean() > 0.05 * one.density.mean()


@pytest.mark.parametrize("changes", [{"obstacles": (SWINGING,)}, FIRE], ids=["moving sphere", "fire"])
def test_threads_change_no_byte(changes: dict, device: str) -> None:
    one, two = (
        list(SmokeSolver(scenario(**changes), device=device, threads=threads).frames())[-1] for threads in (1, 2)
    )
    assert one.density.tobytes() == two.density.tobytes()


def test_no_smoke_inside_a_cylinder(device: str) -> None:
    frame = simulate(scenario(obstacles=(CYLINDER,), warmup_frames=60), device)[-1]
    assert frame.obstacle is not None
    assert frame.obstacle.mean() == pytest.approx(np.pi * 0.15**2, rel=0.03)
    assert frame.density[frame.obstacle > 0.5].max() == 0.0
    assert frame.density[:, 20:].max() > 0.1  # and yet it gets past


def test_a_moving_sphere_pushes_the_air(device: str) -> None:
    first, *_, last = simulate(scenario(obstacles=(SWINGING,)), device)
    assert first.obstacle is not None and last.obstacle is not None and last.velocity_m_s is not None
    x = voxel_centres(last.grid)[..., 0]
    way = np.average(x, weights=last.obstacle) - np.average(x, weights=first.obstacle)
    assert way == pytest.approx(0.4 * 2 * 0.05, rel=0.05)
    assert last.density[last.obstacle > 0.5].max() == 0.0
    inside = last.obstacle.reshape(16, 2, 16, 2, 16, 2).min(axis=(1, 3, 5)) == 1.0
    np.testing.assert_allclose(last.velocity_m_s[inside].mean(axis=0), [0.4, 0.0, 0.0], atol=0.02)


def test_a_fire_glows_smokes_and_grows(device: str) -> None:
    frame = simulate(scenario(**FIRE), device)[-1]
    assert frame.emission is not None
    assert frame.emission.max() > 1.0
    assert frame.density.max() > 0.05  # soot: the inlet feeds none
    above = voxel_centres(frame.grid)[..., 1] > -0.3
    assert frame.emission[above].max() > 0.0


def test_wind_bends_a_jet(device: str) -> None:
    wind = {"face": "x_low", "speed_m_s": 0.7, "turbulence": 0.0}
    config = scenario(
        winds=(wind,),
        flow={"faces": {"x_high": "open", "y_high": "slip", "z_low": "slip", "z_high": "slip"}},
        warmup_frames=10,
    )
    frame = simulate(config, device)[-1]
    assert np.average(voxel_centres(frame.grid)[..., 0], weights=frame.density) > 0.05
    assert frame.velocity_m_s is not None
    assert frame.velocity_m_s[..., 0].mean() == pytest.approx(0.7, rel=0.25)


@pytest.mark.parametrize("streaming", ["two_grids", "in_place"])
@pytest.mark.parametrize("changes", [{"obstacles": (CYLINDER,)}, FIRE], ids=["cylinder", "fire"])
def test_a_resumed_run_ends_with_the_same_bytes(changes: dict, streaming: str, device: str, tmp_path: Path) -> None:
    config = scenario(**changes, flow={"streaming": streaming})
    whole = SmokeSolver(config, device=device)
    for _ in range(3):
        whole.advance()
    save_checkpoint(tmp_path / "checkpoint.npz", whole)
    resumed = SmokeSolver(config, device=device)
    load_checkpoint(tmp_path / "checkpoint.npz", resumed)
    assert resumed.frames_done == 3 and resumed.time_s == whole.time_s
    for _ in range(2):
        whole.advance()
        resumed.advance()
    a, b = whole.frame(), resumed.frame()
    assert a.density.tobytes() == b.density.tobytes()
    assert a.velocity_m_s is not None and b.velocity_m_s is not None
    assert a.velocity_m_s.tobytes() == b.velocity_m_s.tobytes()


def test_a_checkpoint_of_something_else_is_refused(device: str, tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.npz"
    save_checkpoint(path, SmokeSolver(scenario(), device=device))
    load_checkpoint(path, SmokeSolver(scenario(frames=9), device=device))  # more frames are welcome
    with pytest.raises(ValueError, match="another scenario.*delete it"):
        load_checkpoint(path, SmokeSolver(scenario(seed=5), device=device))
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ValueError, match="not a readable checkpoint.*delete it"):
        load_checkpoint(path, SmokeSolver(scenario(), device=device))


def test_a_jet_of_thin_air_stays_finite(device: str) -> None:
    config = scenario(viscosity_m2_s=0.0, resolution={"cells": 24, "refinement": 2}, frames=1, warmup_frames=49)
    frame = simulate(config, device)[-1]
    assert frame.velocity_m_s is not None
    assert np.abs(frame.velocity_m_s).max() < 4.0


def test_a_flow_that_blows_up_tells_the_step_and_what_to_do(device: str) -> None:
    thin = scenario(viscosity_m2_s=0.0, frames=200, flow={"model": "bgk", "smagorinsky": 0.0})
    solver = SmokeSolver(thin, device=device)
    with pytest.raises(FlowError, match=r"(?s)blew up at lattice step \d+.*lower lattice_speed.*raise flow.smag"):
        for _ in solver.frames():
            pass
