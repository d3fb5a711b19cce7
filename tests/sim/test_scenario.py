"""Scenario files and what they refuse."""

from pathlib import Path

import numpy as np
import pytest

from sixway.core.config import ConfigError, dump_config, load_config, parse_config
from sixway.core.frames import Grid
from sixway.sim.inlets import Gusts
from sixway.sim.obstacles import Sphere, solid_fraction
from sixway.sim.scenario import ScenarioConfig

CONFIGS = sorted((Path(__file__).parents[2] / "configs" / "sim").glob("*.yaml"))
INLET = {"centre_m": [0.0, -0.5, 0.0], "radius_m": 0.1}
SPHERE = {"kind": "sphere", "centre_m": [0.0, 0.1, 0.0], "radius_m": 0.1}


def parse(**changes: object) -> ScenarioConfig:
    return parse_config(ScenarioConfig, {"name": "test", "inlets": [INLET], **changes}, source="test")


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_shipped_scenarios_load_and_come_back(path: Path) -> None:
    config = load_config(ScenarioConfig, path)
    assert config.name == path.stem
    assert parse_config(ScenarioConfig, config.model_dump(mode="json"), source="dump") == config
    assert "inlets" in dump_config(config)


def test_there_are_shipped_scenarios() -> None:
    assert {"jet_tiny", "jet_cylinder_tiny", "jet_sphere_tiny"} <= {path.stem for path in CONFIGS}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"inlets": [{**INLET, "centre_m": [0.0, -0.6, 0.0]}]}, r"outside the box.*\(0.5, 0.5, 0.5\) m.*move it in"),
        ({"inlets": [{**INLET, "towards": [0.0, -1.0, 0.0]}]}, "out of the box.*turn"),
        ({"inlets": [{**INLET, "towards": [0.0, 0.0, 0.0]}]}, "length 0.*component"),
        ({"inlets": [{**INLET, "radius_m": 0.03}]}, "1.5 velocity cells.*at least"),
        ({"inlets": []}, "inlets.*at least 1"),
        ({"obstacles": [{**SPHERE, "centre_m": [0.0, -0.4, 0.0]}]}, "obstacle covers it.*move or shrink"),
        ({"obstacles": [{**SPHERE, "centre_m": [0.0, 2.0, 0.0]}]}, "outside the box.*move it in"),
        ({"obstacles": [{**SPHERE, "radius_m": 0.02}]}, "1.5 velocity cells.*at least"),
        ({"obstacles": [{**SPHERE, "kind": "cube"}]}, "obstacles.*cylinder"),
        ({"steps_per_frame": 10}, "multiple.*change one"),
        ({"steps_per_frame": 32, "steps_per_advection": 16}, "skips.*lower"),
        ({"lattice_speed": 0.15, "inlets": [{**INLET, "turbulence": 0.5}]}, "peaks at 0.38.*lower lattice_speed"),
        ({"buoyancy_m_s2": 100.0}, "could lift.*lower it to"),
        ({"lattice_speed": 0.3}, "lattice_speed.*0.15"),
        ({"cells_xyz": [4, 32, 32]}, "cells_xyz.*8"),
        ({"viscosity": 1.0}, "did you mean 'viscosity_m2_s'"),
    ],
)
def test_a_bad_scenario_is_told_value_rule_and_remedy(changes: dict, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse(**changes)


def test_gusts_stand_across_their_waves_and_have_the_asked_strength(rng: np.random.Generator) -> None:
    gusts = Gusts.draw(rng, radius=4.0, speed=0.1, turbulence=0.3)
    np.testing.assert_allclose(np.sum(gusts.wave * gusts.amplitude, axis=1), 0.0, atol=1e-12)
    x = rng.uniform(0.0, 10_000.0, (20_000, 3))
    u = np.cos(x @ gusts.wave.T + gusts.phase) @ gusts.amplitude
    assert np.sqrt(np.mean(np.sum(u**2, axis=1))) == pytest.approx(0.03, rel=0.02)


def test_the_solid_fraction_of_a_sphere_adds_up_to_its_volume() -> None:
    sphere = Sphere(kind="sphere", centre_m=(0.1, 0.0, 0.0), radius_m=0.3)
    fraction = solid_fraction((sphere,), Grid.centred((32, 32, 32)))
    assert fraction.dtype == np.float32
    assert fraction.mean() == pytest.approx(4.0 / 3.0 * np.pi * 0.3**3, rel=0.01)
