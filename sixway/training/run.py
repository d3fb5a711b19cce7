"""The moving parts of a training run, and the four parts of a step."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.optim.swa_utils import get_ema_multi_avg_fn

from sixway.core.store import provenance, sha256_file
from sixway.data.clips import Batch
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST
from sixway.models.card import NetCard
from sixway.models.encoding import encode_lightmap
from sixway.models.unet import SixWayUNet
from sixway.training.config import TrainConfig
from sixway.training.distributed import Ranks
from sixway.training.networks import build_loss
from sixway.training.schedule import ema_decay, learning_rate

_ADAM_EPSILON = 1e-12
"""Far below the gradients of a net at 44 dB; with the usual 1e-8, nearly half of its weights would hardly learn."""


class Run:
    """Net, averaged net, optimiser and loss on one device.

    dataset: the training split. Pictures and weights are kept channels-last, which the convolutions of
    both CPUs and tensor cores prefer; the arithmetic is the same.
    """

    def __init__(self, config: TrainConfig, dataset: SmokeDataset, *, device: str, ranks: Ranks) -> None:
        self.config = config
        self.dataset = dataset
        self.device = device
        self.ranks = ranks
        net = SixWayUNet(
            config.net,
            guide_channels=dataset.guide_channels,
            guide_scale=dataset.scale,
            emissive_scale=dataset.emissive_scale,
        )
        self.net = net.to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.averaged = copy.deepcopy(self.net).requires_grad_(False).eval()
        self.parallel = ranks.wrap(self.net)
        self.parameters = list(self.net.parameters())
        # fused: one kernel for all parameters; a loop over 150 small tensors costs several times as much
        self.optimiser = torch.optim.Adam(self.parameters, lr=config.train.lr, eps=_ADAM_EPSILON, fused=True)
        self.loss = build_loss(config.loss, steps=config.train.steps).to(device)

    def read(self, step: int) -> Batch:
        """The batch of a step, on the device: a function of seed, step and rank alone."""
        settings = self.config.train
        rng = np.random.default_rng([settings.seed, step, self.ranks.rank])
        batch = self.dataset.batch(rng, num_pairs=settings.pairs_per_batch, flip=settings.flip, draw=settings.draw)
        return batch.to(self.device)

    def step(self, step: int, batch: Batch) -> dict[str, Tensor]:
        """One optimiser step; the loss terms, on the device (reading them waits for it)."""
        total, terms = self.compare(step, batch)
        total.backward()
        norm = self.update(step)
        self.average(step)
        return {"loss": total.detach(), **terms, "gradient_norm": norm}

    def compare(self, step: int, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss of what the net answers, and its terms."""
        target = encode_lightmap(batch.target, scale=self.dataset.scale, emissive_scale=self.dataset.emissive_scale)
        is_half = self.config.train.precision == "bf16"
        with torch.autocast(torch.device(self.device).type, torch.bfloat16, enabled=is_half):
            predicted = self.parallel(batch.guide)
        return self.loss(
            predicted,
            target,
            has_emissive=self.dataset.has_emissive,
            is_pair=True,
            step=step,
            true_flow=batch.flow,
        )

    def update(self, step: int) -> Tensor:
        """Clip the gradients, go one step and forget them; their norm before it."""
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate(step)
        norm = torch.nn.utils.clip_grad_norm_(self.parameters, self.config.train.clip_norm)
        self.optimiser.step()
        self.optimiser.zero_grad(set_to_none=True)
        return norm

    @torch.no_grad()
    def average(self, step: int) -> None:
        """Move the averaged weights towards the net's, all tensors in one call."""
        move = get_ema_multi_avg_fn(ema_decay(step, decay=self.config.train.ema))
        move(list(self.averaged.parameters()), self.parameters, None)

    def rate(self, step: int) -> float:
        """The learning rate of a step."""
        settings = self.config.train
        return learning_rate(step, steps=settings.steps, peak=settings.lr, warmup_steps=settings.warmup_steps)

    def state(self, step: int) -> dict[str, Any]:
        """All that the next step depends on: randomness is a function of the step itself."""
        return {
            "step": step,
            "dataset": self.dataset.identity,
            "net": self.net.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }

    def resume(self, state: dict[str, Any]) -> None:
        """Take up a checkpoint. Raises ValueError if it is of another net or dataset."""
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

    def card(self, *, steps: int) -> NetCard:
        """The card of the averaged net after so many steps."""
        manifest = self.dataset.manifest
        commonest = max(self.dataset.groups, key=lambda group: len(group.samples))
        return NetCard(
            net=self.config.net,
            guide_name=self.config.guide,
            guide=self.dataset.guide_identity,
            guide_channels=self.dataset.guide_channels,
            scale=self.dataset.scale,
            emissive_scale=self.dataset.emissive_scale,
            has_emissive=self.dataset.has_emissive,
            medium=manifest.medium,
            height_px=commonest.height_px,
            width_px=commonest.width_px,
            steps=steps,
            dataset=manifest.name,
            dataset_sha256=sha256_file(Path(self.config.data) / MANIFEST),
            loss=self.loss.describe(),
            provenance=provenance(),
        )
