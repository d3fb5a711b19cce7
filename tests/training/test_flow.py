"""Pairs whose flow is known by construction, and a training run in miniature: made, interrupted, continued."""

import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from sixway import train_flow
from sixway.core.store import read_json, read_json_lines
from sixway.models.flow_warp import warp
from sixway.models.flownet import CARD, WEIGHTS, load_flownet
from sixway.training.checkpoint import LATEST
from sixway.training.flow_data import Clip
from sixway.training.flow_pairs import (
    MovingClip,
    PairSampler,
    endpoint_error,
    moved_pair,
    simulated_pair,
    spread_out,
)
from sixway.training.log import METRICS

SIZE = 32
SPEED = (1.0, -0.5)
"""px a frame, right and down."""


def drifting_clip(*, frames: int = 5) -> MovingClip:
    """Puffs that drift at one speed, opaque everywhere: motion and change of the picture agree exactly."""
    y, x = np.mgrid[: 2 * SIZE, : 2 * SIZE] / 2.0
    pictures = []
    for frame in range(frames):
        dx, dy = frame * SPEED[0], frame * SPEED[1]
        centres = ((14.0, 16.0, 3.0), (20.0, 12.0, 2.5), (11.0, 22.0, 4.0))
        pictures.append(
            0.1 + sum(np.exp(-((x - u - dx) ** 2 + (y - v - dy) ** 2) / (2.0 * r**2)) for u, v, r in centres)
        )
    motion = np.broadcast_to(np.array(SPEED)[:, None, None], (frames, 2, SIZE, SIZE))
    ones = np.ones((frames, SIZE, SIZE), np.float16)
    clip = Clip(pictures=np.array(pictures, np.float16), motion=motion.astype(np.float16), spread=0 * ones, alpha=ones)
    return MovingClip(clip)


def change(pair, flow) -> float:
    inner = np.s_[..., 6:-6, 6:-6]
    return float((warp(pair.second, flow) - pair.first)[inner].abs().mean())


def test_motion_adds_up_over_frames() -> None:
    flow = drifting_clip().flow(1, 3)
    torch.testing.assert_close(flow, torch.tensor([3.0, -1.5]).reshape(1, 2, 1, 1).expand(1, 2, SIZE, SIZE))


@pytest.mark.parametrize("make", [moved_pair, simulated_pair])
def test_the_flow_of_a_pair_brings_the_second_picture_onto_the_first(make) -> None:
    pair = make(drifting_clip(), 1, 3)
    assert change(pair, pair.flow) < 0.05 * change(pair, torch.zeros_like(pair.flow))


def test_a_drift_adds_to_the_motion() -> None:
    drift = torch.tensor([-2.0, 1.0]).reshape(1, 2, 1, 1).expand(1, 2, SIZE, SIZE).contiguous()
    pair = moved_pair(drifting_clip(), 0, 2, drift=drift)
    torch.testing.assert_close(pair.flow[..., 16, 16], torch.tensor([[0.0, 0.0]]), atol=1e-4, rtol=0.0)
    assert change(pair, pair.flow) < 2e-3


def test_a_part_of_the_real_frame_is_mixed_in() -> None:
    clip = drifting_clip()
    clip.pictures[0] = 0.0
    pair, mixed = moved_pair(clip, 0, 1), moved_pair(clip, 0, 1, real_share=0.5)
    assert mixed.first.mean() < 0.9 * pair.first.mean()
    torch.testing.assert_close(mixed.flow, pair.flow)


def test_flow_is_spread_over_what_is_empty_and_kept_where_it_is_not() -> None:
    weight = torch.zeros(1, 1, 16, 24)
    weight[..., 4:12, 4:12] = 1.0
    flow = torch.tensor([2.0, -1.0]).reshape(1, 2, 1, 1) * weight
    spread = spread_out(flow, weight)
    torch.testing.assert_close(spread[..., 5:11, 5:11], flow[..., 5:11, 5:11], rtol=0.1, atol=0.0)
    assert (spread[:, 0] > 1.0).all() and (spread[:, 1] < -0.5).all()
    assert spread_out(0.0 * flow, 0.0 * weight).abs().max() == 0.0


def test_drawn_pairs_agree_with_their_flow_whichever_way_they_lie() -> None:
    sampler = PairSampler([drifting_clip()], most_stride=3, crop_px=32)
    pairs = sampler.batch(np.random.default_rng(3), size=24)
    assert len(pairs) == 24 and pairs.first.shape == (24, 1, 32, 32) and pairs.flow.shape == (24, 2, 32, 32)
    better = 0
    for i in range(24):
        inner = np.s_[i : i + 1, :, 8:-8, 8:-8]
        # brightness changes smoothly as well: compare the pictures' shapes
        seen, still, moved = (
            picture[inner] / picture[inner].mean()
            for picture in (pairs.first, pairs.second, warp(pairs.second, pairs.flow))
        )
        better += int((moved - seen).abs().mean() < 0.9 * (still - seen).abs().mean())
    assert better >= 20
    assert len({tuple(flow[:, 16, 16].sign().tolist()) for flow in pairs.flow}) == 4  # it lies in every quadrant


def test_draws_are_a_function_of_the_generator() -> None:
    sampler = PairSampler([drifting_clip()], most_stride=2, crop_px=24)
    one, two, other = (sampler.batch(np.random.default_rng(seed), size=2).second for seed in (1, 1, 2))
    assert torch.equal(one, two) and not torch.equal(one, other)


def test_strides_fit_the_clips() -> None:
    with pytest.raises(ValueError, match="most_stride=5"):
        PairSampler([drifting_clip()], most_stride=5, crop_px=32)
    with pytest.raises(ValueError, match="no clips"):
        PairSampler([], most_stride=1, crop_px=32)


def test_endpoint_error_is_a_weighted_mean() -> None:
    flow, truth = torch.zeros(1, 2, 4, 4), torch.zeros(1, 2, 4, 4)
    truth[:, 0, :2], truth[:, 1, :2] = 3.0, 4.0
    alpha = torch.ones(1, 1, 4, 4)
    assert endpoint_error(flow, truth, alpha).item() == pytest.approx(2.5)
    alpha[:, :, :2] = 0.5
    assert endpoint_error(flow, truth, alpha).item() == pytest.approx(5.0 / 3.0)


MINIATURE = """
data: {data}
clips:
  frames: 3
  size_px: 32
  guide: {{lights: all, sum_lights: false, lighting: sweep, scatter_iterations: 1}}
  sources:
    - {{name: a, split: train, scenario: {scenario}, yaws_deg: [0, 90], set: [resolution=tiny, warmup_frames=8]}}
    - {{name: b, split: val, scenario: {scenario}, set: [resolution=tiny, warmup_frames=8, seed=9]}}
net: {{features: [6, 8], decoders: [8, 8], reaches_px: [1, 2]}}
train:
  {{steps: 6, pairs_per_batch: 2, crop_px: 32, most_stride: 2, warmup_steps: 1, log_every: 1, validate_every: 3,
   checkpoint_every: 3}}
"""


@pytest.fixture(scope="module")
def miniature(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flow")
    scenario = Path(__file__).parents[2] / "configs/sim/jet.yaml"
    config = folder / "flow.yaml"
    config.write_text(MINIATURE.format(data=folder / "data", scenario=scenario))
    assert train_flow.main([str(config), "--run-dir", str(folder / "whole")]) == 0
    return config


def test_a_dry_run_makes_nothing(tmp_path: Path, miniature: Path, capsys: pytest.CaptureFixture[str]) -> None:
    elsewhere = f"data={tmp_path / 'data'}"
    assert train_flow.main([str(miniature), elsewhere, "--run-dir", str(tmp_path / "run"), "--dry-run"]) == 0
    assert "2 simulations to make" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_a_run_leaves_a_net_that_can_be_used(miniature: Path) -> None:
    run = miniature.parent / "whole"
    net = load_flownet(run)
    assert torch.isfinite(net(torch.rand(1, 1, 32, 32), torch.rand(1, 1, 32, 32))).all()
    card = read_json(run / CARD)
    assert card["scores"]["zero_flow_moved_px"] > 0.0 and card["steps"] == 6
    lines = read_json_lines(run / METRICS)
    assert sum("loss" in line for line in lines) == 6 and sum("epe_moved_px" in line for line in lines) == 2


def test_an_interrupted_run_ends_as_if_it_had_not_been(miniature: Path) -> None:
    whole, broken = miniature.parent / "whole", miniature.parent / "broken"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sixway.training.flow.pyramid_loss", _acts_after(4, _fail))
        assert train_flow.main([str(miniature), "--run-dir", str(broken)]) == 2
    assert (broken / LATEST).is_file() and not (broken / WEIGHTS).is_file()
    assert train_flow.main([str(miniature), "--run-dir", str(broken)]) == 0
    assert (whole / WEIGHTS).read_bytes() == (broken / WEIGHTS).read_bytes()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_run_that_is_asked_to_stop_saves_at_once(
    miniature: Path, tmp_path: Path, number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the middle of its fifth step, which is no step of a checkpoint; it ends as if nothing had happened."""
    before, whole, stopped = signal.getsignal(number), miniature.parent / "whole", tmp_path / "stopped"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sixway.training.flow.pyramid_loss", _acts_after(4, lambda: signal.raise_signal(number)))
        assert train_flow.main([str(miniature), "--run-dir", str(stopped)]) == 130
    assert "stopped after step 5; the same command continues" in capsys.readouterr().err
    assert torch.load(stopped / LATEST, weights_only=True)["step"] == 5
    assert signal.getsignal(number) is before
    assert train_flow.main([str(miniature), "--run-dir", str(stopped)]) == 0
    assert (whole / WEIGHTS).read_bytes() == (stopped / WEIGHTS).read_bytes()
    assert read_json_lines(whole / METRICS) == read_json_lines(stopped / METRICS)


def _fail() -> None:
    raise RuntimeError("killed")


def _acts_after(steps: int, act: Callable[[], None]):
    """The loss, and `act` in each step after so many."""
    from sixway.training.flow import pyramid_loss

    calls = []

    def loss(*arguments):
        calls.append(None)
        if len(calls) > steps:
            act()
        return pyramid_loss(*arguments)

    return loss


def test_a_folder_holds_one_run(miniature: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert train_flow.main([str(miniature), "train.lr=5e-4", "--run-dir", str(miniature.parent / "whole")]) == 2
    assert "another config" in capsys.readouterr().err


def test_only_what_is_missing_is_made(
    miniature: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from sixway.training import flow_data

    made = []
    monkeypatch.setattr(
        flow_data,
        "draw_clips",
        lambda source, *_, **__: made.append(source.name) or {"pictures": np.zeros(1)},
    )
    data = miniature.parent / "data"
    kept = sorted(data.iterdir())
    shutil.copytree(data, miniature.parent / "part")
    next((miniature.parent / "part").glob("b_*")).unlink()
    status = train_flow.main([str(miniature), f"data={miniature.parent / 'part'}", "--run-dir", str(data / "x")])
    assert status == 2 and made == ["b"]
    assert "damaged" in capsys.readouterr().err  # the stand-in is no clip
    assert [path for path in sorted(data.iterdir()) if path.name != "x"] == kept


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("clips.guide.sum_lights=true", "six maps"),
        ("clips.sources.1.name=a", "named twice"),
        ("clips.sources.0.scenario=nowhere.yaml", "nowhere.yaml"),
        ("train.step=3", "unknown key"),
    ],
)
def test_mistakes_in_the_config(
    override: str, message: str, miniature: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train_flow.main([str(miniature), override, "--run-dir", "unused"]) == 2
    assert message in capsys.readouterr().err
