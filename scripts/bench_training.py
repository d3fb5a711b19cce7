"""Speed of the training loop on two cores: pictures a second by number format and memory layout, and where time goes.

    python scripts/bench_training.py --json bench_training.json

The net of the main run on random pictures, squared error alone. Settings are measured in turn, step by step,
so that what else the machine does meets all of them alike.
"""

import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from measurement import Measurement, parser

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.store import sha256_file
from sixway.data.clips import Batch
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST, Group, Manifest, PackedArray, Sample
from sixway.models.unet import UNetConfig
from sixway.training.config import OptimiserConfig, TrainConfig
from sixway.training.distributed import Ranks
from sixway.training.prefetch import prefetch
from sixway.training.run import Run

NET = UNetConfig(widths=(32, 48, 96, 160, 256), adapter_width=24)
GUIDE_CHANNELS = (*DIRECTIONS, "transmittance", "depth")
PAIRS = 4


def main() -> int:
    options = parser(__doc__.splitlines()[0])
    options.add_argument("--device", default="cpu", help="cpu or cuda (default: cpu)")
    options.add_argument("--threads", type=int, default=2, help="of the CPU (default: 2)")
    given = options.parse_args()
    torch.set_num_threads(given.threads)
    size, repetitions = (64, 5) if given.quick else (128, 25)
    about = {"net": NET.model_dump(mode="json"), "size_px": size, "pictures": 2 * PAIRS, "threads": given.threads}
    measured = Measurement(about, repetitions)
    wait = torch.cuda.synchronize if given.device.startswith("cuda") else lambda: None
    with tempfile.TemporaryDirectory() as folder:
        _write_dataset(Path(folder), size)
        runs = {
            (precision, layout): _run(Path(folder), precision, layout, device=given.device)
            for precision in ("fp32", "bf16")
            for layout in ("nchw", "channels_last")
        }
        seconds: dict[tuple[str, str], list[float]] = {key: [] for key in runs}
        for step in range(repetitions + 1):
            for key, run in runs.items():
                batch = _laid_out(run.read(step), key[1])
                start = _now(wait)
                run.step(step, batch)
                seconds[key].append(_now(wait) - start)
        for key, times in seconds.items():
            speed = 2 * PAIRS / statistics.median(times[1:])
            fastest = key == ("bf16", "channels_last") and not given.quick
            measured.add(f"{' '.join(key)}, the step alone", speed, "img/s", at_least=35.0 if fastest else None)

        run = runs["bf16", "channels_last"]
        for name, share in _shares(run, repetitions, wait).items():
            measured.add(f"share of {name}", share, "%")
        for ahead in (False, True):
            speed = 2 * PAIRS / _seconds_a_step(run, repetitions, ahead=ahead, wait=wait)
            bound = 35.0 if ahead and not given.quick else None
            how = "read ahead" if ahead else "read in turn"
            measured.add(f"bf16 channels_last with batches {how}", speed, "img/s", at_least=bound)
    return measured.finish(given.json)


def _run(data: Path, precision: str, layout: str, *, device: str) -> Run:
    torch.manual_seed(0)
    train = OptimiserConfig(steps=10_000, pairs_per_batch=PAIRS, precision=precision)  # type: ignore[arg-type]
    config = TrainConfig(data=str(data), guide="bench", net=NET, train=train)
    run = Run(config, SmokeDataset(data, guide="bench", split="train"), device=device, ranks=Ranks())
    if layout == "nchw":
        run.net.to(memory_format=torch.contiguous_format)
        run.averaged.to(memory_format=torch.contiguous_format)
    return run


def _laid_out(batch: Batch, layout: str) -> Batch:
    if layout == "channels_last":
        return batch
    return Batch(guide=batch.guide.contiguous(), target=batch.target.contiguous())


def _shares(run: Run, repetitions: int, wait: Callable[[], None]) -> dict[str, float]:
    """Percent of a step that each of its parts takes, one after the other."""
    names = ("batch", "forward and loss", "backward", "clipping and Adam", "averaging")
    rounds = []
    for step in range(repetitions + 1):
        times = [_now(wait)]
        batch = run.read(step)
        times.append(_now(wait))
        total, _ = run.compare(step, batch)
        times.append(_now(wait))
        total.backward()
        times.append(_now(wait))
        run.update(step)
        times.append(_now(wait))
        run.average(step)
        times.append(_now(wait))
        rounds.append(np.diff(times))
    medians = np.median(rounds[1:], axis=0)
    return dict(zip(names, (100.0 * medians / medians.sum()).tolist(), strict=True))


def _seconds_a_step(run: Run, repetitions: int, *, ahead: bool, wait: Callable[[], None]) -> float:
    """Median, the reading of the batch included."""
    steps = range(repetitions + 1)
    batches = prefetch(run.read, steps) if ahead else ((step, run.read(step)) for step in steps)
    ends = []
    for step, batch in batches:
        run.step(step, batch)
        ends.append(_now(wait))
    return statistics.median(np.diff(ends))


def _now(wait: Callable[[], None]) -> float:
    wait()
    return time.perf_counter()


def _write_dataset(folder: Path, size: int) -> None:
    """Sixteen pairs of noise."""
    rng = np.random.default_rng(0)
    frames, arrays = 32, {}
    for name, channels in (("guide_bench", GUIDE_CHANNELS), ("target", LIGHTMAP_CHANNELS[:-1])):
        path = folder / f"{name}.npy"
        np.save(path, rng.random((frames, len(channels), size, size), dtype=np.float32).astype(np.float16))
        arrays[name] = PackedArray(path=path.name, sha256=sha256_file(path), channels=channels)
    view = {"yaw_deg": 0.0, "pitch_deg": 0.0, "margin": 0.0, "density_scale": 1.0}
    samples = tuple(
        Sample(simulation="noise", view="0", frame=i, seed=0, target="", target_sha256="", **view)  # type: ignore[arg-type]
        for i in range(frames)
    )
    manifest = Manifest(
        name="noise",
        scale=1.0,
        medium={},
        guides={"bench": {"sum_lights": False, "lights": list(DIRECTIONS)}},
        groups=(Group(split="train", height_px=size, width_px=size, arrays=arrays, samples=samples),),
        config={},
        provenance={},
    )
    (folder / MANIFEST).write_text(json.dumps(manifest.model_dump(mode="json")))


if __name__ == "__main__":
    sys.exit(main())
