"""How hard each loss term pulls at the net, and the weights that make the auxiliary ones pull a tenth as hard as MSE.

python scripts/balance_losses.py configs/train/cpu.yaml --net runs/cpu

The norm of a term's gradient over all weights of the net, on real training batches. It hangs on how good the net is:
squared error fades as the net learns, the auxiliary terms less so. Measure with a trained net (--net); a fresh one
suggests weights that are too large later on. Suggested is 0.1 * median(MSE norm) / median(term norm) of a term that
is computed on every step; `auxiliary_every` makes up for its own pauses and changes nothing here. The cosine tells
where a term agrees with squared error (1) or minds its own business (0). Terms whose weights cannot be had are skipped
by name; VGG16 is tried only if the config names it, since it may mean a download of half a gigabyte.
"""

import statistics
import sys
import time
from pathlib import Path

import torch
from measurement import Measurement, parser
from torch import Tensor

from sixway.core.config import load_config
from sixway.data.clips import Batch
from sixway.data.dataset import SmokeDataset
from sixway.losses.total import LossConfig
from sixway.models.card import load_net
from sixway.training.config import TrainConfig
from sixway.training.distributed import Ranks
from sixway.training.networks import build_loss
from sixway.training.run import Run

SHARE = 0.1


def main() -> int:
    options = parser("Gradient norm of every loss term, and balanced weights.")
    options.add_argument("config", type=Path, help="training config, such as configs/train/cpu.yaml")
    options.add_argument("overrides", nargs="*", metavar="key=value", help="overrides, such as data=runs/other")
    options.add_argument("--net", type=Path, help="run folder of a trained net; without it the net is fresh")
    options.add_argument("--batches", type=int, default=24, help="batches to measure on (default: 24; --quick: 6)")
    options.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N (default: cpu)")
    chosen = options.parse_intermixed_args()
    config = load_config(TrainConfig, chosen.config, chosen.overrides)
    torch.manual_seed(config.train.seed)
    dataset = SmokeDataset(Path(config.data), guide=config.guide, split="train")
    run = Run(config, dataset, device=chosen.device, ranks=Ranks())
    if chosen.net:
        run.net.load_state_dict(load_net(chosen.net)[0].state_dict())
    batches = [run.read(step) for step in range(6 if chosen.quick else chosen.batches)]
    measured = Measurement({"config": str(chosen.config), "net": str(chosen.net or "fresh")}, len(batches))

    squared, seconds = gradients(run, LossConfig(colour=config.loss.colour), batches)
    reference = statistics.median(float(g.norm()) for g in squared)
    measured.add("mse: gradient norm", reference, "")
    measured.add("mse: forward and backward", 1e3 * seconds, "ms")
    for name, loss in candidates(config.loss).items():
        try:
            pulls, both_seconds = gradients(run, loss, batches)
        except (ValueError, OSError) as error:
            print(f"{name}: skipped: {error}", file=sys.stderr)
            continue
        norm = statistics.median(float(g.norm()) for g in pulls)
        cosine = statistics.median(
            float(torch.cosine_similarity(a, b, dim=0)) for a, b in zip(pulls, squared, strict=True)
        )
        measured.add(f"{name}: gradient norm", norm, "")
        measured.add(f"{name}: cosine with mse", cosine, "")
        measured.add(f"{name}: forward and backward over mse's", both_seconds / seconds, "x")
        measured.add(f"{name}: suggested weight", SHARE * reference / norm if norm > 0.0 else float("nan"), "")
    return measured.finish(chosen.json)


def candidates(config: LossConfig) -> dict[str, LossConfig]:
    """A loss of one auxiliary term each."""
    losses = {
        f"perceptual, {name}": LossConfig(mse=0.0, perceptual=1.0, features=name)
        for name in ("gradients", "efficientnet_lite0")
    }
    if config.features == "vgg16":
        losses["perceptual, vgg16"] = LossConfig(
            mse=0.0, perceptual=1.0, features="vgg16", vgg_weights=config.vgg_weights
        )
    for name in ("lucas_kanade", "flownet"):
        losses[f"flow, {name}"] = LossConfig(mse=0.0, flow=1.0, estimator=name)
    return losses


def gradients(run: Run, config: LossConfig, batches: list[Batch]) -> tuple[list[Tensor], float]:
    """The gradient over all weights in one vector, batch by batch; and the median time of a batch [s]."""
    run.loss = build_loss(config).to(run.device)
    pulls, times = [], []
    for step, batch in enumerate(batches):
        start = time.perf_counter()
        total, _ = run.compare(step, batch)
        parts = torch.autograd.grad(total, run.parameters, materialize_grads=True)
        pulls.append(torch.cat([part.flatten() for part in parts]))
        times.append(time.perf_counter() - start)
    return pulls, statistics.median(times)


if __name__ == "__main__":
    sys.exit(main())
