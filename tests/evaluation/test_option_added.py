"""An option that comes later, with a default that changes nothing: nothing made before becomes foreign to it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic.fields import FieldInfo

from sixway.core.config import Config, Introduced
from sixway.data.dataset import SmokeDataset
from sixway.evaluation.compare import compare
from sixway.export import main as export
from sixway.export import training_guides
from sixway.generation.command import main
from sixway.generation.plan import DatasetConfig, Plan
from sixway.guide.config import GuideConfig
from sixway.inference.predict import load_predictor
from sixway.reference.lightmaps import ReferenceConfig
from sixway.sim.scenario import AirConfig, ScenarioConfig

SHIPPED = Path(__file__).parents[2] / "sixway" / "zoo" / "unet_naf"
_DATASET = """\
name: small
simulations:
  - {name: jet, split: train, scenario: %(scenario)s, set: [seed=1]}
  - {name: jet_test, split: test, scenario: %(scenario)s, set: [seed=2]}
pairs_per_simulation: 1
views: [{yaws_deg: [0, 30], margin: 0.75, width_px: 24, height_px: 24}]
medium: {extinction_per_m: 24.0}
guides: {rich: %(rich)s}
reference: {samples: 1}
noise_of: []
"""


def rebuild(*models: type[Config]) -> None:
    for model in models:
        model.model_rebuild(force=True)


@pytest.fixture
def later() -> Iterator[None]:
    """The version after this one: guides, references and scenarios have learnt an option."""
    learnt = (GuideConfig, ReferenceConfig, AirConfig)
    for model in learnt:
        model.model_fields["added"] = FieldInfo.from_annotated_attribute(Annotated[float, Introduced(0.0)], 0.0)
    rebuild(*learnt, ScenarioConfig, DatasetConfig)
    yield
    for model in learnt:
        del model.model_fields["added"]
    rebuild(*learnt, ScenarioConfig, DatasetConfig)


@pytest.fixture
def dataset(tiny_dataset: Any, tmp_path: Path) -> Path:
    """The config of a small dataset with the guide of the shipped net."""
    rich = json.loads((SHIPPED / "model.json").read_text())["guide"]
    path = tmp_path / "small.yaml"
    path.write_text(_DATASET % {"scenario": tiny_dataset.config.parent / "puff.yaml", "rich": json.dumps(rich)})
    return path


def folders(plan: Plan) -> list[str]:
    simulation = plan.simulations[0]
    view = simulation.views[0]
    return [
        plan.density(simulation).path,
        plan.target(simulation, view).path,
        plan.guide("rich", simulation, view).path,
    ]


def test_no_folder_is_renamed(dataset: Path, request: pytest.FixtureRequest) -> None:
    before = folders(Plan.read(dataset))
    request.getfixturevalue("later")
    plan = Plan.read(dataset)
    assert plan.config.guides["rich"].model_dump()["added"] == 0.0  # the option is there
    assert folders(plan) == before
    used = folders(Plan.read(dataset, ("guides.rich.added=1.0", "reference.added=1.0")))
    assert [a == b for a, b in zip(used, before, strict=True)] == [True, False, False]
    blown = Plan.read(dataset, ("simulations.0.set=[flow.added=1.0]",))
    assert blown.simulations[0].scenario.flow.model_dump()["added"] == 1.0
    assert folders(blown)[0].rpartition("/")[0] == before[0].rpartition("/")[0] and folders(blown)[0] not in used


def test_the_shipped_net_is_scored_and_calibrated_on_a_dataset_packed_after_it(
    dataset: Path, later: None, tmp_path: Path
) -> None:
    assert main([str(dataset), "--out", str(tmp_path / "data"), "--workers", "1", "--no-estimate"]) == 0
    net = load_predictor(SHIPPED, device="cpu")
    test = SmokeDataset(tmp_path / "data", guide="rich", split="test")
    report, _ = compare(net, tmp_path / "data", test, tmp_path / "report", training={})
    assert report["frames"] == 4
    file = tmp_path / "int8.onnx"
    options = ["--target", "ort", "--precision", "int8", "--data", str(tmp_path / "data"), "--output", str(file)]
    assert export([str(SHIPPED), *options]) == 0
    assert load_predictor(file, device="cpu").card.guide == net.card.guide


def test_a_guide_that_uses_the_option_is_another(dataset: Path, later: None, tmp_path: Path) -> None:
    out = tmp_path / "data"
    assert main([str(dataset), "--out", str(out), "--workers", "1", "--no-estimate", "guides.rich.added=1.0"]) == 0
    with pytest.raises(ValueError, match="not the one that this net was trained on"):
        training_guides(out, load_predictor(SHIPPED, device="cpu").card, 32)
