"""The training loop. Every step is a function of (seed, step, rank), so a resumed run is the same run."""

import math
import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from sixway.core.config import Config, dump_config, load_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.progress import track
from sixway.core.store import provenance, sha256_file, write_json, write_text
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST
from sixway.losses.total import LossConfig, TotalLoss
from sixway.models.card import NetCard, save_net
from sixway.models.encoding import encode_lightmap
from sixway.models.features import GradientFeatures
from sixway.models.flownet import LucasKanade
from sixway.models.unet import SixWayUNet, UNetConfig
from sixway.training.checkpoint import load_checkpoint, save_checkpoint
from sixway.training.distributed import Ranks, process_group
from sixway.training.log import MetricsLog
from sixway.training.schedule import ema_decay, learning_rate

CONFIG = "config.yaml"
_VALIDATION_PAIRS = 16


class OptimiserConfig(Config):
    """Adam under a warm-up and a cosine, on pairs of consecutive frames."""

    steps: int = Field(ge=1)
    pairs_per_batch: int = Field(default=2, ge=1)
    """A batch holds twice as many pictures."""
    lr: float = Field(default=1e-3, gt=0.0)
    warmup_steps: int = Field(default=50, ge=1)
    clip_norm: float = Field(default=1.0, gt=0.0)
    ema: float = Field(default=0.999, ge=0.0, lt=1.0)
    """Decay of the averaged weights, which are what is saved, evaluated and exported."""
    flip: bool = True
    precision: Literal["fp32", "bf16"] = "fp32"
    seed: int = Field(default=0, ge=0)
    log_every: int = Field(default=50, ge=1)
    validate_every: int = Field(default=500, ge=1)
    checkpoint_every: int = Field(default=500, ge=1)


class TrainConfig(Config):
    """A training run: which data, which guide, which net, which loss."""

    data: str
    """Dataset folder."""
    guide: str
    """Guide variant of the dataset that the net reads."""
    net: UNetConfig = UNetConfig()
    train: OptimiserConfig
    loss: LossConfig = LossConfig()


class Interrupted(RuntimeError):
    """The run was asked to stop; its state is saved."""


def train(config: TrainConfig, *, run_dir: Path, device: str) -> None:
    """Train, or continue, the run in `run_dir`; ends with `model.safetensors` and its card there.

    Raises ValueError if the folder holds a run of another config or dataset, RuntimeError if the loss
    stops being finite, `Interrupted` after SIGINT or SIGTERM.
    """
    with process_group(device) as (ranks, own_device), stop_on_signal() as asked_to_stop:
        torch.manual_seed(config.train.seed)
        dataset = SmokeDataset(Path(config.data), guide=config.guide, split="train")
        validation = SmokeDataset(Path(config.data), guide=config.guide, split="val")
        if ranks.is_first:
            _claim(run_dir, config)
        run = Run(config, dataset, device=own_device, ranks=ranks)
        start = run.resume(load_checkpoint(run_dir))
        log = MetricsLog(run_dir, from_step=start) if ranks.is_first else None
        if log and start == 0:
            write_json(run_dir / "run.json", {"provenance": provenance(), "loss": run.loss.describe()})

        settings = config.train
        steps = range(start, settings.steps)
        for step in track(steps, total=settings.steps, label="train", start=start) if ranks.is_first else steps:
            terms = run.step(step)
            done, stopping = step + 1, bool(asked_to_stop)
            if log:
                is_last = done == settings.steps
                logs = done % settings.log_every == 0
                validates = is_last or done % settings.validate_every == 0
                saves = is_last or stopping or done % settings.checkpoint_every == 0
                finite = _finite(terms, step) if logs or validates or saves else {}
                if logs:
                    log.write(step, lr=run.rate(step), **finite)
                if validates:
                    log.write(step, validation_psnr_db=run.validate(validation))
                if saves:
                    save_checkpoint(run_dir, run.state(done))
            if stopping:
                raise Interrupted(f"stopped after step {done}; the same command continues from there")
        if ranks.is_first:
            run.net.load_state_dict(run.averaged.module.state_dict())
            save_net(run_dir, run.net, run.card())


class Run:
    """The moving parts of a training run."""

    def __init__(self, config: TrainConfig, dataset: SmokeDataset, *, device: str, ranks: Ranks) -> None:
        self.config = config
        self.dataset = dataset
        self.device = device
        self.ranks = ranks
        self.scale = dataset.manifest.scale
        self.net = SixWayUNet(config.net, guide_channels=dataset.guide_channels, guide_scale=self.scale).to(device)
        self.parallel = ranks.wrap(self.net)
        self.averaged = AveragedModel(self.net, avg_fn=self._average)
        self.optimiser = torch.optim.Adam(self.net.parameters(), lr=config.train.lr)
        self.loss = build_loss(config.loss).to(device)
        self._at_step = 0

    def step(self, step: int) -> dict[str, Tensor]:
        """One optimiser step; the loss terms, on the device (reading them waits for it)."""
        settings = self.config.train
        self._at_step = step
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate(step)
        rng = np.random.default_rng([settings.seed, step, self.ranks.rank])
        batch = self.dataset.batch(rng, num_pairs=settings.pairs_per_batch, flip=settings.flip)
        guide = batch.guide.to(self.device, non_blocking=True)
        target = encode_lightmap(batch.target.to(self.device, non_blocking=True), scale=self.scale)
        with torch.autocast(self.device.split(":")[0], torch.bfloat16, enabled=settings.precision == "bf16"):
            predicted = self.parallel(guide)
        total, terms = self.loss(predicted, target, has_emissive=self.dataset.has_emissive, is_pair=True, step=step)
        self.optimiser.zero_grad(set_to_none=True)
        total.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.net.parameters(), settings.clip_norm)
        self.optimiser.step()
        self.averaged.update_parameters(self.net)
        return {"loss": total.detach(), **terms, "gradient_norm": norm}

    def rate(self, step: int) -> float:
        settings = self.config.train
        return learning_rate(step, steps=settings.steps, peak=settings.lr, warmup_steps=settings.warmup_steps)

    @torch.no_grad()
    def validate(self, dataset: SmokeDataset) -> float:
        """PSNR [dB] of the mean squared error of the averaged net, six maps in sRGB, over some validation pairs."""
        self.averaged.eval()
        errors = []
        for group, described in enumerate(dataset.groups):
            pairs = len(described.samples) // 2
            for row in range(0, pairs, max(1, pairs // _VALIDATION_PAIRS)):
                pair = dataset.pair(group, row)
                target = encode_lightmap(pair.target.to(self.device), scale=self.scale)
                difference = self.averaged(pair.guide.to(self.device)).float() - target
                errors.append(difference[:, : len(DIRECTIONS)].square().mean().item())
        return -10.0 * math.log10(sum(errors) / len(errors))

    def state(self, step: int) -> dict[str, Any]:
        """All that the next step depends on: randomness is a function of the step itself."""
        return {
            "step": step,
            "dataset": self.dataset.identity,
            "net": self.net.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }

    def resume(self, state: dict[str, Any] | None) -> int:
        """Take up a checkpoint; the step to continue with. Raises ValueError if it is of another net or dataset."""
        if state is None:
            return 0
        if state.get("dataset") != self.dataset.identity:
            raise ValueError(
                f"{self.config.data}: is not the dataset that this run began with (its frames or its brightness "
                "scale changed); use another --run-dir"
            )
        try:
            self.net.load_state_dict(state["net"])
            self.averaged.load_state_dict(state["averaged"])
            self.optimiser.load_state_dict(state["optimiser"])
        except (KeyError, RuntimeError, ValueError) as error:
            raise ValueError(f"the checkpoint does not fit this config: {error}; use another --run-dir") from error
        return int(state["step"])

    def card(self) -> NetCard:
        manifest, group = self.dataset.manifest, self.dataset.groups[0]
        return NetCard(
            net=self.config.net,
            guide_name=self.config.guide,
            guide=self.dataset.guide_config,
            guide_channels=self.dataset.guide_channels,
            scale=self.scale,
            has_emissive=self.dataset.has_emissive,
            medium=manifest.medium,
            height_px=group.height_px,
            width_px=group.width_px,
            steps=self.config.train.steps,
            dataset=manifest.name,
            dataset_sha256=sha256_file(Path(self.config.data) / MANIFEST),
            loss=self.loss.describe(),
            provenance=provenance(),
        )

    def _average(self, averaged: Tensor, current: Tensor, _: Tensor | int) -> Tensor:
        return torch.lerp(current, averaged, ema_decay(self._at_step, decay=self.config.train.ema))


def build_loss(config: LossConfig) -> TotalLoss:
    """The loss with the networks that its config names."""
    features = GradientFeatures() if config.features == "gradients" else None
    estimator = LucasKanade() if config.estimator == "lucas_kanade" else None
    return TotalLoss(config, features=features, estimator=estimator)


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """Collects SIGINT and SIGTERM into a list while the block runs; a step in hand is finished first."""
    caught: list[int] = []
    handlers = {
        number: signal.signal(number, lambda n, _: caught.append(n)) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield caught
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _finite(terms: dict[str, Tensor], step: int) -> dict[str, float]:
    values = {name: float(value) for name, value in terms.items()}
    if not all(map(math.isfinite, values.values())):
        raise RuntimeError(
            f"step {step}: the loss is no longer finite ({values}); lower train.lr or use fp32, and delete the "
            "checkpoints made since it went wrong"
        )
    return values


def _claim(run_dir: Path, config: TrainConfig) -> None:
    """Mark a fresh folder as this run's; refuse a folder that holds another run."""
    path = run_dir / CONFIG
    if not path.is_file():
        write_text(path, dump_config(config))
        return
    old, new = (_flat(settings.model_dump(mode="json")) for settings in (load_config(TrainConfig, path), config))
    changed = [f"{key}: {old[key]} there, {new[key]} here" for key in new if old[key] != new[key]]
    if changed:
        raise ValueError(
            f"{run_dir}: holds a run of another config ({'; '.join(changed)}); "
            "use another --run-dir, or the old settings"
        )


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """``{"a": {"b": 1}}`` as ``{"a.b": 1}``."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat
