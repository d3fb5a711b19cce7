"""No folder is renamed: what the configs of the repository name is what it was when folders were first named."""

import json
from pathlib import Path
from typing import Any

import pytest

from sixway.core.config import load_config
from sixway.core.store import content_hash
from sixway.generation.plan import Plan
from sixway.sim.scenario import ScenarioConfig
from sixway.training.flow import FlowTrainConfig
from sixway.training.flow_data import FlowData

CONFIGS = Path(__file__).parents[2] / "configs"
NAMES: dict[str, Any] = json.loads((Path(__file__).parent / "identities.json").read_text())
"""As commit 42fbf12 named them; a hash of paths where there are many."""


@pytest.mark.parametrize("name", ["cpu", "paper", "tiny"])
def test_folders_of_a_dataset(name: str) -> None:
    plan = Plan.read(CONFIGS / "data" / f"{name}.yaml")
    paths = {layer: [] for layer in ("density", "target", "flow", *(f"guide_{guide}" for guide in plan.config.guides))}
    for simulation in plan.simulations:
        paths["density"].append(plan.density(simulation).path)
        for view in simulation.views:
            paths["target"].append(plan.target(simulation, view).path)
            paths["flow"].append(plan.flow(simulation, view).path)
            for guide in plan.config.guides:
                paths[f"guide_{guide}"].append(plan.guide(guide, simulation, view).path)
    assert {layer: content_hash(found) for layer, found in paths.items()} == NAMES["data"][name]


def test_scenarios() -> None:
    files = sorted((CONFIGS / "sim").glob("*.yaml"))
    found = {path.stem: content_hash(load_config(ScenarioConfig, path).identity()) for path in files}
    assert {name: found[name] for name in NAMES["sim"]} == NAMES["sim"]


def test_clips_of_the_flow_net() -> None:
    path = CONFIGS / "train" / "flow.yaml"
    clips = load_config(FlowTrainConfig, path).clips
    data = FlowData.read(clips, scenarios_from=path.parent, folder=Path("clips"))
    assert [file.name for _, file in data._files()] == NAMES["flow"]
