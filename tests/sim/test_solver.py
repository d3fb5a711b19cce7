"""Whole simulations, small."""

import numpy as np
import pytest

from sixway.core.records import DensityFrame
from sixway.sim.inlets import InletConfig
from sixway.sim.obstacles import Cylinder, voxel_centres
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

JET = InletConfig(centre_m=(0.0, -0.5, 0.0), radius_m=0.15, swirl=0.5, turbulence=0.3)


def scenario(**changes: object) -> ScenarioConfig:
    """A jet in a box of 16^3 cells, just long enough to rise."""
    fields: dict = {"name": "test", "cells_xyz": (16, 16, 16), "frames": 3, "warmup_frames": 5, "inlets": (JET,)}
    return ScenarioConfig(**{**fields, **changes})


def simulate(config: ScenarioConfig, device: str) -> list[DensityFrame]:
    return list(SmokeSolver(config, device=device).frames())


def test_frames_hold_what_they_promise(device: str) -> None:
    config = scenario(
        cells_xyz=(16, 24, 12),
        longest_edge_m=3.0,
        inlets=(JET.model_copy(update={"centre_m": (0.0, -1.5, 0.0), "radius_m": 0.5}),),
    )
    frames = simulate(config, device)
    assert len(frames) == 3
    frame = frames[-1]
    assert frame.density.shape == (24, 48, 32)
    assert frame.grid == config.density_grid
    assert frame.grid.voxel_size_m == pytest.approx(3.0 / 48)
    assert frame.velocity_m_s is not None and frame.velocity_m_s.shape == (12, 24, 16, 3)
    assert frame.time_s == pytest.approx(8 * 16 * 0.1 * 0.125)
    assert 0.5 < frame.velocity_m_s[..., 1].max() < 3.0  # the inlet blows 1 m/s up, gusts included
    assert not np.array_equal(frames[0].density, frame.density)  # frames are copies, not views


def test_smoke_rises(device: str) -> None:
    first, *_, last = simulate(scenario(), device)
    assert height(first) < height(last)
    assert last.density.max() <= 1.0


def height(frame: DensityFrame) -> float:
    """Mean height of the smoke [m]."""
    return float(np.average(voxel_centres(frame.grid)[..., 1], weights=frame.density))


def test_same_seed_same_bytes_other_seed_other_plume(device: str) -> None:
    one, again, other = (simulate(scenario(seed=seed), device)[-1] for seed in (1, 1, 2))
    assert one.density.tobytes() == again.density.tobytes()
    assert one.velocity_m_s is not None and again.velocity_m_s is not None
    assert one.velocity_m_s.tobytes() == again.velocity_m_s.tobytes()
    assert np.abs(one.density - other.density).mean() > 0.05 * one.density.mean()


def test_no_smoke_inside_a_cylinder(device: str) -> None:
    cylinder = Cylinder(kind="cylinder", axis="z", centre_m=(0.05, 0.0, 0.0), radius_m=0.15)
    frame = simulate(scenario(obstacles=(cylinder,), warmup_frames=30), device)[-1]
    assert frame.obstacle is not None
    volume = frame.obstacle.mean()
    assert volume == pytest.approx(np.pi * 0.15**2, rel=0.03)
    assert frame.density[frame.obstacle > 0.5].max() == 0.0
    assert frame.density[:, 20:].max() > 0.1  # and yet it gets past


def test_a_jet_of_thin_air_stays_finite(device: str) -> None:
    config = scenario(viscosity_m2_s=0.0, cells_xyz=(24, 24, 24), frames=1, warmup_frames=49, steps_per_advection=8)
    frame = simulate(config, device)[-1]
    assert frame.velocity_m_s is not None
    assert np.abs(frame.velocity_m_s).max() < 4.0


def test_a_flow_that_blows_up_says_what_to_do(device: str) -> None:
    solver = SmokeSolver(scenario(viscosity_m2_s=0.0, smagorinsky=0.0, frames=200, advection="linear"), device=device)
    with pytest.raises(RuntimeError, match=r"(?s)blew up.*lower lattice_speed.*raise smagorinsky"):
        for _ in solver.frames():
            pass
