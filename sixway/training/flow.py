"""Training of FlowNet. Every step is a function of (seed, step), so a resumed run is the same run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from sixway.core.config import Config, dump_config
from sixway.core.progress import track
from sixway.core.store import content_hash, provenance, read_json, write_json
from sixway.models.flownet import FlowCard, FlowNet, FlowNetConfig, save_flownet
from sixway.training.checkpoint import load_checkpoint, save_checkpoint
from sixway.training.flow_data import FlowData, FlowDataConfig
from sixway.training.flow_pairs import FlowPairs, MovingClip, PairSampler, endpoint_error, moved_pair, simulated_pair
from sixway.training.interruption import Interrupted, stop_on_signal
from sixway.training.log import MetricsLog
from sixway.training.schedule import learning_rate

_LEVEL_WEIGHTS = (1.0, 0.5, 0.25, 0.15)
"""Of the finest level, the next coarser one, ...: every level learns from the start, the last one counts."""

_SURROUNDINGS = 0.02
"""Weight of a pixel without smoke: no flow can be seen there, and wild answers would spoil the crop of a warp."""

_STILL_PX = 0.5
"""Errors count relative to a pair's own motion plus this."""


class FlowOptimiserConfig(Config):
    """AdamW under a warm-up and a cosine, on pairs of square crops."""

    steps: int = Field(ge=1)
    pairs_per_batch: int = Field(default=16, ge=1)
    crop_px: int = Field(default=96, ge=32)
    most_stride: int = Field(default=5, ge=1)
    """Frames between the two pictures of a pair, at most."""
    lr: float = Field(default=1e-3, gt=0.0)
    weight_decay: float = Field(default=1e-4, ge=0.0)
    warmup_steps: int = Field(default=100, ge=1)
    clip_norm: float = Field(default=1.0, gt=0.0)
    seed: int = Field(default=0, ge=0)
    log_every: int = Field(default=50, ge=1)
    validate_every: int = Field(default=250, ge=1)
    checkpoint_every: int = Field(default=250, ge=1)


class FlowTrainConfig(Config):
    """A training run of the flow estimator."""

    data: str
    """Folder of the clips; what is missing there is made first."""
    clips: FlowDataConfig
    net: FlowNetConfig = FlowNetConfig()
    train: FlowOptimiserConfig


def train_flow(config: FlowTrainConfig, data: FlowData, *, run_dir: Path, device: str) -> dict[str, float]:
    """Train, or continue, the run in `run_dir` on clips that are there; ends with weights and card, returns the scores.

    Raises ValueError if the folder holds a run of another config or of other clips, RuntimeError if the loss is no
    longer finite, `Interrupted` after SIGINT or SIGTERM.
    """
    with stop_on_signal() as asked_to_stop:
        return _train(config, data, run_dir=run_dir, device=device, asked_to_stop=asked_to_stop)


def _train(
    config: FlowTrainConfig, data: FlowData, *, run_dir: Path, device: str, asked_to_stop: Sequence[int]
) -> dict[str, float]:
    """`train_flow`, until anything is in `asked_to_stop`."""
    _claim(run_dir, config, data)
    torch.manual_seed(config.train.seed)
    settings = config.train
    clips = [MovingClip(clip) for clip in data.clips("train")]
    sampler = PairSampler(clips, most_stride=settings.most_stride, crop_px=settings.crop_px)
    validation = ValidationPairs([MovingClip(clip) for clip in data.clips("val")], most_stride=settings.most_stride)
    net = FlowNet(config.net).to(device)
    optimiser = torch.optim.AdamW(net.parameters(), lr=settings.lr, weight_decay=settings.weight_decay)
    start = 0
    if (state := load_checkpoint(run_dir)) is not None:
        net.load_state_dict(state["net"])
        optimiser.load_state_dict(state["optimiser"])
        start = int(state["step"])
    log = MetricsLog(run_dir, from_step=start)
    scores: dict[str, float] = {}
    for step in track(range(start, settings.steps), total=settings.steps, label="train", start=start):
        rate = learning_rate(step, steps=settings.steps, peak=settings.lr, warmup_steps=settings.warmup_steps)
        for group in optimiser.param_groups:
            group["lr"] = rate
        rng = np.random.default_rng([settings.seed, step])
        pairs = sampler.batch(rng, size=settings.pairs_per_batch)
        flows = net.pyramid(pairs.first.to(device), pairs.second.to(device))
        loss = pyramid_loss(flows, pairs.flow.to(device), pairs.alpha.to(device))
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), settings.clip_norm)
        optimiser.step()
        done = step + 1
        stopping = bool(asked_to_stop)
        ends = done == settings.steps
        logs = ends or done % settings.log_every == 0
        saves = ends or stopping or done % settings.checkpoint_every == 0
        if (logs or saves) and not torch.isfinite(loss):
            raise RuntimeError(f"step {step}: the loss is no longer finite; lower train.lr in a new --run-dir")
        if logs:
            log.write(step, loss=loss.item(), lr=rate)
        if ends or done % settings.validate_every == 0:
            scores = validation.scores(net, device=device)
            log.write(step, **scores)
        if saves:
            save_checkpoint(run_dir, {"step": done, "net": net.state_dict(), "optimiser": optimiser.state_dict()})
        if stopping:
            raise Interrupted(f"stopped after step {done}; the same command continues from there")
    scores = scores or validation.scores(net, device=device)
    card = FlowCard(
        net=config.net,
        steps=settings.steps,
        data=content_hash([data.identity]),
        size_px=config.clips.size_px,
        scores=scores,
        provenance=provenance(),
    )
    save_flownet(run_dir, net, card)
    return scores


def pyramid_loss(flows: list[Tensor], truth: Tensor, alpha: Tensor) -> Tensor:
    """Error over the smoke relative to how far a pair moves, weighted over the levels. flows: coarsest first."""
    weight = alpha + _SURROUNDINGS
    still = torch.zeros_like(truth)
    motion = endpoint_error(still, truth, weight) + _STILL_PX
    errors = [(endpoint_error(flow, truth, weight) / motion).mean() for flow in reversed(flows)]
    return torch.stack([level * error for level, error in zip(_LEVEL_WEIGHTS, errors, strict=False)]).sum()


class ValidationPairs:
    """Fixed pairs of whole pictures: moved ones, whose flow is exact, and frames as simulated."""

    def __init__(self, clips: list[MovingClip], *, most_stride: int) -> None:
        if not clips:
            raise ValueError("there are no clips to validate on; give a source of split val")
        self.moved: list[FlowPairs] = []
        self.simulated: list[FlowPairs] = []
        for number, clip in enumerate(clips):
            for i in range(_PAIRS_A_CLIP):
                stride = 1 + (number + i) % most_stride
                frame = i * (len(clip) - stride - 1) // max(1, _PAIRS_A_CLIP - 1)
                self.moved.append(moved_pair(clip, frame, stride))
                self.simulated.append(simulated_pair(clip, frame, stride))

    @torch.no_grad()
    def scores(self, net: FlowNet, *, device: str) -> dict[str, float]:
        """Endpoint error over the smoke [px] and that of no flow at all, on either kind of pair."""
        scores: dict[str, float] = {}
        for kind, pairs in (("moved", self.moved), ("simulated", self.simulated)):
            errors = [
                [
                    endpoint_error(flow, pair.flow, pair.alpha).item()
                    for flow in (net(pair.first.to(device), pair.second.to(device)).cpu(), torch.zeros_like(pair.flow))
                ]
                for pair in pairs
            ]
            error, zero = np.mean(errors, axis=0)
            scores |= {f"epe_{kind}_px": round(float(error), 4), f"zero_flow_{kind}_px": round(float(zero), 4)}
        return scores


_PAIRS_A_CLIP = 5


def _claim(run_dir: Path, config: FlowTrainConfig, data: FlowData) -> None:
    """Mark a fresh folder as this run's; refuse one that holds another run."""
    path = run_dir / "run.json"
    mine: dict[str, Any] = {"data": data.identity, "config": dump_config(config)}
    if not path.is_file():
        write_json(path, mine | {"provenance": provenance()})
        return
    there = read_json(path)
    changed = [name for name in mine if there.get(name) != mine[name]]
    if changed:
        raise ValueError(f"{run_dir}: holds a run of another {' and '.join(changed)}; use another --run-dir")
