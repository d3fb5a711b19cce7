"""The plan: which frames are taken, and which settings name which folders."""

import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sixway.core.config import ConfigError
from sixway.generation.plan import Plan, pair_frames


@given(st.integers(2, 200), st.data())
def test_pairs_are_disjoint_in_order_and_inside_the_sequence(num_frames: int, data: st.DataObject) -> None:
    num_pairs = data.draw(st.integers(1, num_frames // 2))
    frames = pair_frames(num_frames, num_pairs)
    assert len(frames) == 2 * num_pairs
    assert list(frames) == sorted(set(frames))
    assert frames[-1] < num_frames
    assert all(a % 2 == 0 and b == a + 1 for a, b in zip(frames[::2], frames[1::2], strict=True))


@given(st.integers(4, 200), st.data())
def test_a_raised_count_keeps_every_earlier_pair(num_frames: int, data: st.DataObject) -> None:
    more = data.draw(st.integers(2, num_frames // 2))
    fewer = data.draw(st.integers(1, more - 1))
    assert set(pair_frames(num_frames, fewer)) < set(pair_frames(num_frames, more))


@given(st.integers(3, 7))
def test_pairs_are_spread_over_the_sequence(log_pairs: int) -> None:
    starts = pair_frames(2 << log_pairs, 8)[::2]
    gaps = {b - a for a, b in pairwise(starts)}
    assert gaps == {(2 << log_pairs) // 8}


def folders(plan: Plan) -> dict[tuple[str, ...], str]:
    found = {}
    for s in plan.simulations:
        found["density", s.name] = plan.density(s).path
        for v in s.views:
            found["target", s.name, v.name] = plan.target(s, v).path
            found["flow", s.name, v.name] = plan.flow(s, v).path
            for guide in plan.config.guides:
                found[f"guide_{guide}", s.name, v.name] = plan.guide(guide, s, v).path
    return found


def layers_changed(tiny_dataset: Any, *overrides: str) -> set[str]:
    before = folders(Plan.read(tiny_dataset.config))
    after = folders(Plan.read(tiny_dataset.config, overrides))
    assert before.keys() <= after.keys()
    return {key[0] for key, path in before.items() if after[key] != path}


@pytest.mark.parametrize(
    ("override", "changed"),
    [
        ("guides.six.steps_per_edge=20", {"guide_six"}),
        ("guides.paper.jitter=false", {"guide_paper"}),
        ("guides.third={lights: [front]}", set()),
        ("reference.samples=2", {"target"}),
        ("test_samples_factor=8", {"target"}),
        ("medium.extinction_per_m=20.0", {"target", "guide_six", "guide_paper", "flow"}),
        ("views.0.fov_deg=40.0", {"target", "guide_six", "guide_paper", "flow"}),
        ("views.0.yaws_deg=[0, 30, 60]", set()),
        ("pairs_per_simulation=3", set()),
        ("name=other", set()),
        ("seed=4", {"target", "guide_six", "guide_paper", "flow"}),
        ("simulations.0.set.0=seed=9", {"density", "target", "guide_six", "guide_paper", "flow"}),
    ],
)
def test_a_setting_moves_only_the_folders_that_it_makes(tiny_dataset: Any, override: str, changed: set[str]) -> None:
    assert layers_changed(tiny_dataset, override) == changed


def test_one_simulation_never_touches_another(tiny_dataset: Any) -> None:
    before = folders(Plan.read(tiny_dataset.config))
    after = folders(Plan.read(tiny_dataset.config, ("simulations.0.set.0=seed=9",)))
    assert {key[1] for key, path in before.items() if after[key] != path} == {"jet"}


def test_an_added_simulation_keeps_all_the_others(tiny_dataset: Any, tmp_path: Path) -> None:
    shutil.copy(tiny_dataset.config.parent / "puff.yaml", tmp_path)
    text = tiny_dataset.config.read_text()
    new = "  - {name: jet_more, split: train, scenario: puff.yaml, set: [seed=9]}\npairs_per"
    (tmp_path / "more.yaml").write_text(text.replace("pairs_per", new, 1))
    before, plan = Plan.read(tiny_dataset.config), Plan.read(tmp_path / "more.yaml")
    assert len(plan.simulations) == 4
    assert folders(before).items() < folders(plan).items()
    for old, kept in zip(before.simulations, plan.simulations, strict=False):
        assert before.seed(old, old.views[1], 4) == plan.seed(kept, kept.views[1], 4)


def test_every_frame_and_view_has_a_seed_of_its_own(tiny_dataset: Any) -> None:
    plan = Plan.read(tiny_dataset.config)
    seeds = [plan.seed(s, v, f) for s in plan.simulations for v in s.views for f in s.frames]
    assert len(set(seeds)) == len(seeds)


def test_mistakes_in_several_simulations_are_told_at_once(tiny_dataset: Any) -> None:
    overrides = (
        "pairs_per_simulation=5",
        "simulations.1.scenario=nowhere.yaml",
        "simulations.2.set.0=sead=3",
    )
    with pytest.raises(ConfigError) as caught:
        Plan.read(tiny_dataset.config, overrides)
    first, second, third = str(caught.value).splitlines()
    assert "jet: pairs_per_simulation=5 needs 10 frames, its scenario hands over 8; lower the pairs to 4" in first
    assert "jet_val: " in second and "nowhere.yaml" in second
    assert "jet_test: " in third and "sead: unknown key; did you mean 'seed'" in third


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("simulations.1.name=jet", r"\['jet'\] are named twice"),
        ("guides.a-b={lights: [front]}", r"\['a-b'\] must be plain names"),
        ("simulations.1.name=../jet", "simulations.1.name"),
        ("simulations.0.split=training", "simulations.0.split"),
        ("guides.six.lights=[front, front]", "names a light twice"),
        ("reference.samples=0", "reference.samples"),
    ],
)
def test_a_bad_dataset_config_names_the_place(tiny_dataset: Any, override: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        Plan.read(tiny_dataset.config, (override,))


def test_scored_references_take_more_samples(tiny_dataset: Any) -> None:
    plan = Plan.read(tiny_dataset.config)
    samples = {s.split: plan.reference(s).samples for s in plan.simulations}
    assert samples == {"train": 1, "val": 4, "test": 4}
