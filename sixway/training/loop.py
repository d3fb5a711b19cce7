"""The training loop. Every step is a function of (seed, step, rank), so a resumed run is the same run."""

import math
import time
from contextlib import closing, nullcontext
from pathlib import Path

import torch
from torch import Tensor

from sixway.core.config import dump_config, load_config
from sixway.core.progress import track
from sixway.core.store import differences, provenance, write_json, write_text
from sixway.data.dataset import SmokeDataset
from sixway.models.card import CARD, WEIGHTS, save_net
from sixway.training.checkpoint import load_checkpoint, save_checkpoint
from sixway.training.config import TrainConfig
from sixway.training.distributed import process_group
from sixway.training.interruption import Interrupted, stop_on_signal
from sixway.training.log import MetricsLog
from sixway.training.prefetch import prefetch
from sixway.training.run import Run
from sixway.training.true_flow import true_flows
from sixway.training.validation import SCORE, picture, validate, write_picture

CONFIG = "config.yaml"
BEST = "best"
FLOWS = "true_flow"
PICTURES = "validation"


def train(config: TrainConfig, *, run_dir: Path, device: str) -> bool:
    """Train, or continue, the run in `run_dir`; whether there was anything left to do.

    Ends with the averaged net of the last step there (`model.safetensors` and its card), and in `best/`
    that of the best validation; `validation/` holds a picture of each validation.
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
        start = 0
        if state := load_checkpoint(run_dir):
            run.resume(state)
            start = state["step"]
        if start == config.train.steps and all((run_dir / name).is_file() for name in (WEIGHTS, CARD)):
            return False
        if run.loss.flow is not None:
            dataset.pair_flows = true_flows(dataset, run.loss.flow, Path(config.data) / FLOWS, device=own_device)
        best = state["best"] if state else None
        record = Record(run, validation, run_dir, start=start, best=best) if ranks.is_first else None
        with closing(record) if record else nullcontext():
            steps = range(start, config.train.steps)
            batches = prefetch(run.read, steps)
            shown = track(batches, total=config.train.steps, label="train", start=start) if record else batches
            for step, batch in shown:
                terms = run.step(step, batch)
                stopping = bool(asked_to_stop)
                if record:
                    record.after(step, terms, pictures=len(batch.guide), stopping=stopping)
                if stopping:
                    raise Interrupted(f"stopped after step {step + 1}; the same command continues from there")
        if ranks.is_first:
            save_net(run_dir, run.averaged, run.card(steps=config.train.steps))
        return True


class Record:
    """What the first process writes down of a run: log, validations, best net, checkpoints.

    best: score and step of the best validation so far, as the checkpoint of step `start` has it.
    """

    def __init__(
        self, run: Run, validation: SmokeDataset, run_dir: Path, *, start: int, best: dict[str, float] | None
    ) -> None:
        self.run = run
        self.run_dir = run_dir
        self.best = best
        self.validation = validation
        self.log = MetricsLog(run_dir, from_step=start, tensorboard=run.config.train.tensorboard)
        self._pictures, self._since = 0, time.perf_counter()
        if start == 0:
            write_json(run_dir / "run.json", {"provenance": provenance(), "loss": run.loss.describe()})

    def after(self, step: int, terms: dict[str, Tensor], *, pictures: int, stopping: bool) -> None:
        """Write down what is due after a step. Raises RuntimeError if its loss is not finite and anything is due."""
        settings = self.run.config.train
        done = step + 1
        is_last = done == settings.steps
        logs = done % settings.log_every == 0
        validates = is_last or done % settings.validate_every == 0
        saves = is_last or stopping or done % settings.checkpoint_every == 0
        self._pictures += pictures * self.run.ranks.count
        if not (logs or validates or saves):
            return
        finite = _finite(terms, step)
        if logs:
            speed = self._pictures / (time.perf_counter() - self._since)
            self.log.write(step, lr=self.run.rate(step), **finite, images_per_s=round(speed, 1))
        if validates:
            self._validate(done)
        if saves:
            save_checkpoint(self.run_dir, {**self.run.state(done), "best": self.best})
        if logs or validates:
            self._pictures, self._since = 0, time.perf_counter()

    def close(self) -> None:
        self.log.close()

    def _validate(self, done: int) -> None:
        """Score and picture after `done` steps; the net is kept if none before was better."""
        net, device = self.run.averaged, self.run.device
        scores = validate(net, self.validation, device=device)
        self.log.write(done - 1, **scores)
        pixels = picture(net, self.validation, device=device)
        write_picture(self.run_dir / PICTURES / f"step_{done:07d}.png", pixels)
        self.log.show(done - 1, "validation", pixels)
        if self.best is None or scores[SCORE] > self.best[SCORE]:
            save_net(self.run_dir / BEST, net, self.run.card(steps=done))
            self.best = {"step": done, SCORE: scores[SCORE]}


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
    there = load_config(TrainConfig, path, stored=True)
    if changed := differences(there.identity(), config.identity()):
        raise ValueError(
            f"{run_dir}: holds a run of another config ({'; '.join(changed)}); "
            "use another --run-dir, or the old settings"
        )
