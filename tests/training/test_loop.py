"""A run can be stopped and taken up at any step, and says what it is; what would spoil it is refused."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file
from torch import Tensor

from sixway.core.config import dump_config
from sixway.core.store import read_json, read_json_lines
from sixway.data.clips import Batch
from sixway.data.dataset import SmokeDataset
from sixway.losses.flow import FlowLoss
from sixway.models.card import CARD, WEIGHTS, load_net
from sixway.models.encoding import encode_lightmap
from sixway.models.flow_lucas_kanade import LucasKanade
from sixway.train import main
from sixway.training import loop
from sixway.training import run as run_module
from sixway.training.checkpoint import LATEST, PREVIOUS
from sixway.training.config import TrainConfig
from sixway.training.distributed import Ranks
from sixway.training.log import METRICS, TENSORBOARD, MetricsLog
from sixway.training.loop import BEST, FLOWS, PICTURES, Interrupted, train
from sixway.training.run import Run
from sixway.training.true_flow import true_flows

Config = Callable[..., TrainConfig]


@pytest.fixture
def stop_after(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable[[], object]], None]:
    """Do something in the middle of a step of a run to come."""

    def arrange(steps: int, act: Callable[[], object]) -> None:
        whole = Run.step

        def step(self: Run, number: int, batch: Batch) -> dict[str, Tensor]:
            terms = whole(self, number, batch)
            if number == steps - 1:
                act()
            return terms

        monkeypatch.setattr(Run, "step", step)

    return arrange


def result(run_dir: Path) -> tuple[bytes, list[Any]]:
    """What a run makes, but for its speed."""
    lines = read_json_lines(run_dir / METRICS)
    for line in lines:
        line.pop("images_per_s", None)
    return b"".join((folder / WEIGHTS).read_bytes() for folder in (run_dir, run_dir / BEST)), lines


FULL_LOSS = ("loss.perceptual=0.1", "loss.features=gradients", "loss.flow=0.1", "loss.estimator=lucas_kanade")


class Killed(BaseException):
    """Stands for a kill: nothing of the run's own handles it."""


@pytest.mark.parametrize("more", [("train.precision=bf16",), FULL_LOSS], ids=["bf16", "every term"])
def test_a_killed_run_is_resumed_bit_for_bit(
    config: Config,
    mixed_dataset: Path,
    tmp_path: Path,
    stop_after: Any,
    monkeypatch: pytest.MonkeyPatch,
    more: tuple[str, ...],
) -> None:
    """On pictures of two sizes, which different steps see."""
    more = (*more, f"data={mixed_dataset}", "train.draw=sizes")
    train(config(*more), run_dir=tmp_path / "whole", device="cpu")

    def kill() -> None:
        raise Killed

    stop_after(9, kill)
    with pytest.raises(Killed):
        train(config(*more), run_dir=tmp_path / "killed", device="cpu")
    monkeypatch.undo()
    assert not (tmp_path / "killed" / WEIGHTS).exists()
    assert read_json_lines(tmp_path / "killed" / METRICS)[-1]["step"] == 7  # beyond the checkpoint of step 6
    torch.manual_seed(999)  # what else happened in the process must not matter
    train(config(*more), run_dir=tmp_path / "killed", device="cpu")
    assert result(tmp_path / "killed") == result(tmp_path / "whole")
    steps = [line["step"] for line in result(tmp_path / "killed")[1] if "loss" in line]
    assert steps == list(range(12))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_run_that_is_asked_to_stop_saves_at_once(
    config: Config, tmp_path: Path, stop_after: Any, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    before = signal.getsignal(number)
    train(config(), run_dir=tmp_path / "whole", device="cpu")
    stop_after(4, lambda: signal.raise_signal(number))
    with pytest.raises(Interrupted, match="stopped after step 4; the same command continues"):
        train(config(), run_dir=tmp_path / "stopped", device="cpu")
    assert torch.load(tmp_path / "stopped" / LATEST, weights_only=True)["step"] == 4
    assert signal.getsignal(number) is before
    monkeypatch.undo()
    train(config(), run_dir=tmp_path / "stopped", device="cpu")
    assert result(tmp_path / "stopped") == result(tmp_path / "whole")


def test_a_finished_run_is_left_as_it_is(config: Config, tmp_path: Path) -> None:
    assert train(config(), run_dir=tmp_path / "run", device="cpu")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "run").rglob("*")}
    assert not train(config(), run_dir=tmp_path / "run", device="cpu")
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "run").rglob("*")} == before


def test_a_run_killed_before_its_last_file_gets_it(config: Config, tmp_path: Path) -> None:
    assert train(config("train.steps=2"), run_dir=tmp_path, device="cpu")
    before = result(tmp_path)
    (tmp_path / CARD).unlink()
    assert train(config("train.steps=2"), run_dir=tmp_path, device="cpu")
    assert result(tmp_path) == before
    assert load_net(tmp_path)[1].steps == 2


def test_the_seed_decides(config: Config, tmp_path: Path) -> None:
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train(config("train.steps=2", f"train.seed={seed}"), run_dir=tmp_path / name, device="cpu")
    a, b, c = (result(tmp_path / name) for name in "abc")
    assert a == b
    assert a[0] != c[0]


def test_the_loss_falls(trained_run: Path) -> None:
    lines = read_json_lines(trained_run / METRICS)
    losses = [line["loss"] for line in lines if "loss" in line]
    assert [line["step"] for line in lines if "loss" in line] == [4, 9, 14, 19, 24, 29]
    assert losses[-1] < 0.8 * losses[0]
    first, last = (line["validation_psnr_db"] for line in lines if "validation_psnr_db" in line)
    assert last > first > 20.0


@pytest.mark.parametrize("guide", ["six", "paper"])
@pytest.mark.parametrize("more", [(), FULL_LOSS, ("train.precision=bf16",)], ids=["mse", "every term", "bf16"])
def test_twenty_steps_fit_the_training_frames_better(config: Config, guide: str, more: tuple[str, ...]) -> None:
    """Step after step on one and the same batch: the loss must fall whatever its terms."""
    settings = config(f"guide={guide}", "train.steps=1000", "train.lr=1e-3", *more)
    torch.manual_seed(0)
    run = Run(settings, SmokeDataset(Path(settings.data), guide=guide, split="train"), device="cpu", ranks=Ranks())
    batch = run.read(0)
    losses = [float(run.step(step, batch)["loss"]) for step in range(20)]
    assert losses[-1] < 0.8 * losses[0]


def test_every_term_is_logged(config: Config, tmp_path: Path) -> None:
    train(config("train.steps=3", *FULL_LOSS), run_dir=tmp_path, device="cpu")
    for line in read_json_lines(tmp_path / METRICS)[:3]:
        assert line["perceptual"] > 0.0 and line["flow"] >= 0.0
        weighted = line["mse"] + 0.1 * line["perceptual"] + 0.1 * line["flow"]
        assert line["loss"] == pytest.approx(weighted, rel=1e-5)


def test_the_record_says_which_networks_were_missing(config: Config, tmp_path: Path, trained_run: Path) -> None:
    plain = read_json(trained_run / "run.json")["loss"]
    assert plain["mse"] == {"weight": 1.0}
    for term in ("perceptual", "flow"):
        assert plain[term] == {"weight": 0.0, "network": "none", "pretrained": False, "note": "term not used"}
    train(config("train.steps=1", *FULL_LOSS), run_dir=tmp_path, device="cpu")
    for record in (read_json(tmp_path / "run.json")["loss"], read_json(tmp_path / CARD)["loss"]):
        for term, network in (("perceptual", "gradients"), ("flow", "lucas_kanade")):
            assert record[term]["network"] == network
            assert record[term]["pretrained"] is False
            assert "NO pretrained network was used" in record[term]["note"]


def test_the_saved_net_is_the_averaged_one(trained_run: Path, tiny_dataset: Any) -> None:
    state = torch.load(trained_run / LATEST, weights_only=True)
    saved = load_file(trained_run / WEIGHTS)
    assert saved.keys() == state["net"].keys()
    for name, values in saved.items():
        assert torch.equal(values, state["averaged"][name])
    assert any(not torch.equal(values, state["net"][name]) for name, values in saved.items())
    net, card = load_net(trained_run)
    assert not net.training
    assert card.steps == 30 and card.guide_name == "six" and not card.has_emissive
    assert card.scale == SmokeDataset(tiny_dataset.folder, guide="six", split="train").manifest.scale


def test_the_best_net_is_kept_beside_the_last(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop_after: Any
) -> None:
    """Scores are made up: best at step 4, then worse; a run stopped in between remembers what was best."""
    made_up = {2: 30.0, 4: 35.0, 6: 33.0, 8: 34.0}

    def validate(net: Any, *_: Any, **__: Any) -> dict[str, float]:
        scored.append(0)
        return {"validation_psnr_db": made_up[2 * len(scored)]}

    scored: list[int] = []
    monkeypatch.setattr(loop, "validate", validate)
    settings = config("train.steps=8", "train.validate_every=2")
    stop_after(5, lambda: signal.raise_signal(signal.SIGTERM))
    with pytest.raises(Interrupted):
        train(settings, run_dir=tmp_path, device="cpu")
    at_step_4 = (tmp_path / BEST / WEIGHTS).read_bytes()
    train(settings, run_dir=tmp_path, device="cpu")
    assert (tmp_path / BEST / WEIGHTS).read_bytes() == at_step_4 != (tmp_path / WEIGHTS).read_bytes()
    assert load_net(tmp_path / BEST)[1].steps == 4
    assert load_net(tmp_path)[1].steps == 8
    assert torch.load(tmp_path / LATEST, weights_only=True)["best"] == {"step": 4, "validation_psnr_db": 35.0}


def test_true_flows_are_estimated_once(config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = config("train.steps=2", *FULL_LOSS)
    cache = Path(settings.data) / FLOWS
    train(settings, run_dir=tmp_path, device="cpu")
    (cached,) = cache.iterdir()
    flows = np.load(cached)
    assert flows.shape == (4, 2, 20, 24) and flows.dtype == np.float16
    dataset = SmokeDataset(Path(settings.data), guide="six", split="train")
    encoded = encode_lightmap(dataset.pair(0, 3).target, scale=dataset.scale)
    lit = encoded[:, :6].mean(dim=1, keepdim=True)
    expected = LucasKanade()(lit[:1], lit[1:])[0]
    assert expected.abs().max() > 0.1
    np.testing.assert_allclose(flows[3], expected, atol=2e-3)

    def refuse(*_: Any) -> None:
        raise AssertionError("estimated again")

    monkeypatch.setattr(FlowLoss, "flow_of", refuse)
    again = true_flows(dataset, FlowLoss(LucasKanade()), cache, device="cpu")
    np.testing.assert_array_equal(again[0], flows)
    with pytest.raises(AssertionError, match="estimated again"):  # another network by the same name
        other = torch.nn.Linear(1, 1)
        other.name, other.pretrained = "lucas_kanade", True  # type: ignore[assignment]
        true_flows(dataset, FlowLoss(other), cache, device="cpu")  # type: ignore[arg-type]


def test_a_cached_flow_gives_the_loss_that_an_estimated_one_does(config: Config, tmp_path: Path) -> None:
    settings = config(*FULL_LOSS)
    run = Run(settings, SmokeDataset(Path(settings.data), guide="six", split="train"), device="cpu", ranks=Ranks())
    estimated = run.compare(0, run.read(0))[1]["flow"]
    assert run.loss.flow is not None
    run.dataset.pair_flows = true_flows(run.dataset, run.loss.flow, tmp_path, device="cpu")
    assert run.compare(0, run.read(0))[1]["flow"] == pytest.approx(float(estimated), rel=0.01)
    run.dataset.pair_flows = [np.array(run.dataset.pair_flows[0]) + np.float16(3.0)]
    assert run.compare(0, run.read(0))[1]["flow"] > 2.0 + estimated


def test_validations_are_drawn(trained_run: Path) -> None:
    pictures = sorted((trained_run / PICTURES).iterdir())
    assert [path.name for path in pictures] == ["step_0000015.png", "step_0000030.png"]
    with Image.open(pictures[0]) as image:
        # four rows (guide, predicted, true, difference) of up to eight tiles with 2 px between
        assert image.size == (8 * 26, 4 * 22)


def test_tensorboard_shows_what_the_log_holds(config: Config, tmp_path: Path) -> None:
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    settings = config("train.steps=6", "train.log_every=2", "train.tensorboard=true")
    train(settings, run_dir=tmp_path, device="cpu")
    events = accumulator.EventAccumulator(str(tmp_path / TENSORBOARD)).Reload()
    losses = [line["loss"] for line in read_json_lines(tmp_path / METRICS) if "loss" in line]
    assert [event.step for event in events.Scalars("loss")] == [1, 3, 5]
    assert [event.value for event in events.Scalars("loss")] == pytest.approx(losses)
    assert len(events.Images("validation")) == 1


def test_tensorboard_that_is_not_installed_is_told_of(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(ValueError, match=r"not installed; run: pip install 'sixway\[tracking\]'"):
        train(config("train.tensorboard=true"), run_dir=tmp_path, device="cpu")


def test_a_dry_run_tells_the_time_and_writes_nothing(trained_run: Path, tmp_path: Path, capsys: Any) -> None:
    arguments = [str(trained_run.parent / "train.yaml"), "train.steps=5", "--run-dir", str(tmp_path / "run")]
    assert main([*arguments, "--dry-run"]) == 0
    assert re.search(r"5 steps .*\nabout \d+\.\d min .*\ndry run", capsys.readouterr().out)
    assert not (tmp_path / "run").exists()


def test_the_command_says_that_a_run_is_finished(trained_run: Path, capsys: Any) -> None:
    assert main([str(trained_run.parent / "train.yaml"), "--run-dir", str(trained_run)]) == 0
    assert "was finished before, nothing was done" in capsys.readouterr().out


def test_a_folder_of_another_run_is_refused(config: Config, tmp_path: Path) -> None:
    train(config("train.steps=1"), run_dir=tmp_path, device="cpu")
    before = result(tmp_path)
    for override, key in (
        ("train.lr=3e-4", "train.lr"),
        ("net.widths=[8, 16]", "net.widths"),
        ("net.widths=[12, 8]", "net.widths"),
        ("guide=paper", "guide"),
        ("train.steps=2", "train.steps"),
    ):
        with pytest.raises(ValueError, match=rf"holds a run of another config.*{key}.*use another --run-dir"):
            train(config("train.steps=1", override), run_dir=tmp_path, device="cpu")
    assert result(tmp_path) == before


def test_a_run_goes_on_with_its_own_data_only(
    tiny_dataset: Any, config: Config, tmp_path: Path, stop_after: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The dataset folder keeps its name but was generated anew: the run would be of neither."""
    shutil.copytree(tiny_dataset.folder, tmp_path / "data")
    settings = config(f"data={tmp_path / 'data'}")
    stop_after(4, lambda: signal.raise_signal(signal.SIGTERM))
    with pytest.raises(Interrupted):
        train(settings, run_dir=tmp_path / "run", device="cpu")
    monkeypatch.undo()
    manifest = tmp_path / "data" / "manifest.json"
    original = json.loads(manifest.read_text())
    manifest.write_text(json.dumps({**original, "scale": 2.0 * original["scale"]}))
    with pytest.raises(ValueError, match=r"data.*is not the dataset.*use another --run-dir"):
        train(settings, run_dir=tmp_path / "run", device="cpu")
    # the same data packed by another commit is the same data
    manifest.write_text(json.dumps({**original, "provenance": {"commit": "another"}}))
    train(settings, run_dir=tmp_path / "run", device="cpu")


@pytest.mark.parametrize("log_every", [1, 50])
def test_a_loss_that_is_not_finite_stops_the_run_and_saves_nothing(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log_every: int
) -> None:
    encode = run_module.encode_lightmap
    calls = []

    def poisoned(*args: Any, **kwargs: Any) -> Tensor:
        calls.append(0)
        return encode(*args, **kwargs) * (float("nan") if len(calls) > 8 else 1.0)

    monkeypatch.setattr(run_module, "encode_lightmap", poisoned)
    settings = config(f"train.log_every={log_every}", "train.validate_every=100")
    with pytest.raises(RuntimeError, match=r"the loss is no longer finite .*lower train\.lr or use fp32"):
        train(settings, run_dir=tmp_path, device="cpu")
    assert not (tmp_path / WEIGHTS).exists()
    state = torch.load(tmp_path / LATEST, weights_only=True)
    assert state["step"] == 6
    assert all(values.isfinite().all() for values in state["net"].values())


def test_what_is_missing_is_named_before_anything_is_made(tiny_dataset: Any, config: Config, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no finished dataset here"):
        train(config(f"data={tmp_path / 'nothing'}"), run_dir=tmp_path / "run", device="cpu")
    with pytest.raises(ValueError, match="this dataset has: paper, six"):
        train(config("guide=seven"), run_dir=tmp_path / "run", device="cpu")
    assert not (tmp_path / "run").exists()


def test_a_log_drops_what_will_be_done_again(tmp_path: Path) -> None:
    log = MetricsLog(tmp_path, from_step=0)
    for step in range(4):
        log.write(step, loss=float(step))
    with (tmp_path / METRICS).open("a") as file:
        file.write('{"step": 4, "lo')
    MetricsLog(tmp_path, from_step=2).write(2, loss=9.0)
    assert [line["loss"] for line in read_json_lines(tmp_path / METRICS)] == [0.0, 1.0, 9.0]


def test_two_processes_train_one_net(config: Config, tmp_path: Path) -> None:
    (tmp_path / "train.yaml").write_text(dump_config(config("train.steps=5", "train.checkpoint_every=2")))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    torchrun = ["-m", "torch.distributed.run", "--nproc-per-node", "2", "--master-port", port]
    command = [sys.executable, *torchrun, "-m", "sixway.train", str(tmp_path / "train.yaml")]
    done = subprocess.run(
        [*command, "--run-dir", str(tmp_path / "run")],
        capture_output=True,
        text=True,
        timeout=250,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    weights = load_file(tmp_path / "run" / WEIGHTS)
    assert all(values.isfinite().all() for values in weights.values())
    lines = read_json_lines(tmp_path / "run" / METRICS)
    assert [line["step"] for line in lines if "loss" in line] == list(range(5))  # rank 0 alone logs
    # the second process saw other frames: the weights differ from those of one process alone
    train(config("train.steps=5"), run_dir=tmp_path / "alone", device="cpu")
    alone = load_file(tmp_path / "alone" / WEIGHTS)
    assert any(not torch.equal(weights[name], alone[name]) for name in weights)
    assert (tmp_path / "run" / PREVIOUS).is_file()
