"""Scenario files and what they refuse."""

from pathlib import Path

import pytest

from sixway.core.config import ConfigError, dump_config, load_config, parse_config
from sixway.sim.scenario import ScenarioConfig

CONFIGS = sorted((Path(__file__).parents[2] / "configs" / "sim").glob("*.yaml"))
INLET = {"centre_m": [0.0, -0.5, 0.0], "radius_m": 0.1}
PUFF = {"centre_m": [0.0, 0.0, 0.0], "radius_m": 0.1}
SPHERE = {"kind": "sphere", "centre_m": [0.0, 0.1, 0.0], "radius_m": 0.1}
AWAY = {"kind": "rigid", "velocity_m_s": [1.0, 0.0, 0.0]}
ONTO_INLET = {"kind": "rigid", "velocity_m_s": [0.0, -0.4, 0.0]}


def parse(**changes: object) -> ScenarioConfig:
    return parse_config(ScenarioConfig, {"name": "test", "inlets": [INLET], **changes}, source="test")


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_shipped_scenarios_load_at_every_tier_and_come_back(path: Path) -> None:
    for tier in ("tiny", "small", "medium", "paper"):
        config = load_config(ScenarioConfig, path, [f"resolution={tier}"])
        assert config.name == path.stem
        assert parse_config(ScenarioConfig, config.model_dump(mode="json"), source="dump") == config
    assert "smoke" in dump_config(config)


def test_the_promised_scenarios_are_shipped() -> None:
    names = {path.stem for path in CONFIGS}
    assert {f"paper_{n:02d}" for n in range(1, 15)} <= names
    assert {"jet", "plume", "two_jets", "jet_moving_sphere", "jet_bunny", "chimney_wind"} <= names
    burning = {p.stem for p in CONFIGS if load_config(ScenarioConfig, p, ["resolution=tiny"]).burn is not None}
    assert burning == {"fireball", "explosion", "flame"}


def test_tiers_are_those_of_the_help_text() -> None:
    sizes = {"tiny": (32, 64), "small": (64, 128), "medium": (100, 200), "paper": (100, 400)}
    for tier, (cells, voxels) in sizes.items():
        scenario = parse(resolution=tier)
        assert scenario.velocity_grid.shape_zyx == (cells,) * 3
        assert scenario.density_grid.shape_zyx == (voxels,) * 3
        assert scenario.refinement == voxels // cells


def test_a_frame_takes_the_same_time_at_every_tier() -> None:
    for tier in ("tiny", "small", "medium"):
        timing = parse(resolution=tier, frames_per_second=24.0).timing
        assert timing.units.dt_s * timing.steps_per_frame == pytest.approx(1.0 / 24.0)
        assert timing.steps_per_frame % timing.steps_per_advection == 0
        assert timing.units.velocity_to_lattice(1.0) <= 0.1 + 1e-9
        assert timing.steps_per_advection * timing.units.velocity_to_lattice(1.0) <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"inlets": [{**INLET, "centre_m": [0.0, -0.6, 0.0]}]}, r"outside the box.*\(0.5, 0.5, 0.5\) m.*move it in"),
        ({"inlets": [{**INLET, "towards": [0.0, -1.0, 0.0]}]}, "out of the box.*turn"),
        ({"inlets": [{**INLET, "towards": [0.0, 0.0, 0.0]}]}, "length 0.*component"),
        ({"inlets": [{**INLET, "radius_m": 0.03}]}, "1.5 velocity cells.*at least"),
        ({"inlets": []}, "no smoke.*add one"),
        ({"inlets": [], "puffs": [PUFF]}, "how fast.*speed_m_s"),
        ({"puffs": [{**PUFF, "centre_m": [0.0, 0.7, 0.0]}]}, "puffs.0.*outside the box"),
        ({"puffs": [{**PUFF, "start_s": 10.0}]}, "after the last frame.*raise frames"),
        ({"puffs": [{**PUFF, "fuel": 1.0}]}, "nothing burns.*burn"),
        ({"burn": {}}, "no source of fuel"),
        (
            {"winds": [{"face": "x_low", "speed_m_s": 1.0}], "flow": {"faces": {"y_high": "open"}}},
            "no way out.*x_high open",
        ),
        ({"obstacles": [{**SPHERE, "centre_m": [0.0, -0.4, 0.0]}]}, "obstacle covers it.*move or shrink"),
        ({"obstacles": [{**SPHERE, "centre_m": [0.0, 2.0, 0.0]}]}, "outside the box.*move it in"),
        ({"obstacles": [{**SPHERE, "radius_m": 0.02}]}, "thick, below 3 velocity cells.*at least"),
        ({"obstacles": [{**SPHERE, "kind": "cube"}]}, "obstacles.*cylinder"),
        ({"obstacles": [{**SPHERE, "motion": AWAY}]}, "outside the box at .* s.*slow it down"),
        ({"obstacles": [{**SPHERE, "motion": ONTO_INLET}]}, "comes as near as .* at .* s"),
        ({"obstacles": [{"kind": "mesh", "path": "no.obj", "centre_m": [0, 0, 0], "size_m": 0.4}]}, "no.obj"),
        ({"flow": {"faces": {"x_low": "periodic"}}}, "come in pairs"),
        ({"flow": {"faces": {"y_high": "slip"}}}, "no way out.*y_high: open"),
        ({"flow": {"model": "magic"}}, "flow.model.*bgk"),
        ({"lattice_speed": 0.2, "inlets": [{**INLET, "turbulence": 0.5}]}, "peaks at 0.5.*lower lattice_speed"),
        ({"smoke": {"buoyancy_m_s2": 100.0}}, "could drive.*lower it by"),
        ({"smoke": {"scheme": "maccormack"}}, "smoke.scheme.*was removed.*use cubic .sharp. or linear"),
        ({"smoke": {"scheme": "upwind"}}, "smoke.scheme.*cubic.*linear"),
        ({"lattice_speed": 0.3}, "lattice_speed.*0.2"),
        ({"resolution": {"cells": 4, "refinement": 2}}, "resolution.*8"),
        (
            {"resolution": {"cells": 256, "refinement": 4}},
            r"resolution: 1024 x 1024 x 1024 smoke voxels.*812\^3.*lower cells",
        ),
        ({"resolution": "huge"}, "resolution.*tiny"),
        ({"viscosity": 1.0}, "did you mean 'viscosity_m2_s'"),
    ],
)
def test_a_bad_scenario_is_told_value_rule_and_remedy(changes: dict, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse(**changes)


def test_identity_knows_a_mesh_by_its_bytes_and_not_the_number_of_frames(tmp_path: Path) -> None:
    bunny = CONFIGS[0].parent / "meshes" / "bunny.ply"
    (tmp_path / "copy.ply").write_bytes(bunny.read_bytes())
    mesh = {"kind": "mesh", "path": str(bunny), "centre_m": [0.0, 0.1, 0.0], "size_m": 0.4}
    here = parse(obstacles=[mesh])
    there = parse(obstacles=[{**mesh, "path": str(tmp_path / "copy.ply")}], frames=99)
    assert here.identity() == there.identity()
    assert here.identity() != parse(obstacles=[{**mesh, "size_m": 0.41}]).identity()
