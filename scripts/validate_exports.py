"""What each exported file loses, weighs and takes, beside the float32 net in torch.

python scripts/validate_exports.py runs/cpu_rich --data runs/cpu_data --json exports.json

PSNR is over all channels that the data has, in the net's encoding (sRGB light, linear alpha), from the mean squared
error of the test pictures: against the truth, where the loss is what torch has more, and against torch's own answers.
Latency is of one picture under ONNX Runtime on this CPU, the files in turn, medians.
"""

import statistics
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from measurement import Measurement, parser

from sixway.data.dataset import SmokeDataset
from sixway.export import training_guides
from sixway.inference.onnx import EngineNet, export_onnx, finish_dynamic, trace_dynamic
from sixway.inference.onnx_rules import Precision
from sixway.inference.predict import OnnxPredictor
from sixway.metrics.psnr import psnr_of_mse
from sixway.models.card import NetCard, load_net
from sixway.models.encoding import encode_lightmap
from sixway.models.unet import SixWayUNet

SIZES = (128, 256, 512)
ENGINE: tuple[Precision, ...] = ("fp32", "fp16")
ORT: tuple[Precision, ...] = ("fp32", "fp16", "int8")
MOST_LOST_DB = {"fp32": 0.01, "fp16": 0.05}
"""int8 only tells: who takes it weighs its loss against its speed."""

FASTER = 1.05
"""Time of float32 over time of int8 from which int8 counts as faster."""


def main() -> int:
    options = parser((__doc__ or "").splitlines()[0])
    options.add_argument("run_dir", type=Path, help="folder of a trained run")
    options.add_argument(
        "--data", type=Path, required=True, help="dataset: training pictures calibrate, test pictures judge"
    )
    chosen = options.parse_args()
    net, card = load_net(chosen.run_dir)
    quick = chosen.quick
    about = {"net": str(chosen.run_dir), "data": str(chosen.data), "threads": torch.get_num_threads()}
    result = Measurement(about, repetitions=5 if quick else 30)
    pictures = test_pictures(chosen.data, card, most_pairs=2 if quick else 40)
    with tempfile.TemporaryDirectory() as folder:
        files = Files(net, card, Path(folder))
        files.write_dynamic(training_guides(chosen.data, card, net.stride))
        judge(result, files, pictures)
        for size in SIZES:
            time_size(result, files, size)
    told(result)
    return result.finish(chosen.json)


@dataclass
class Files:
    """The exports of one net: `ort` files by precision, files for engines by precision and size."""

    net: SixWayUNet
    card: NetCard
    folder: Path
    ort: dict[Precision, Path] = field(default_factory=dict)

    def write_dynamic(self, guides: list[np.ndarray]) -> None:
        graph = trace_dynamic(self.net, self.card)
        for precision in ORT:
            path = self.folder / f"ort_{precision}.onnx"
            finish_dynamic(graph, self.net, self.card, path, precision=precision, guides=guides)
            self.ort[precision] = path

    def engine(self, precision: Precision, width_px: int, height_px: int) -> Path:
        path = self.folder / f"engine_{precision}_{width_px}x{height_px}.onnx"
        if not path.exists():
            export_onnx(self.net, self.card, path, width_px=width_px, height_px=height_px, precision=precision)
        return path

    def predictors(self, width_px: int, height_px: int) -> dict[str, OnnxPredictor]:
        """Every file that runs at this size."""
        paths = {f"engine {p}": self.engine(p, width_px, height_px) for p in ENGINE}
        paths |= {f"ort {p}": path for p, path in self.ort.items()}
        return {name: OnnxPredictor(path, device="cpu") for name, path in paths.items()}


@dataclass(frozen=True)
class Pair:
    """Guides [2, g, h, w] and what the net should answer."""

    guide: np.ndarray
    truth: np.ndarray


def test_pictures(folder: Path, card: NetCard, *, most_pairs: int) -> list[Pair]:
    """From all over the test split, of every image size."""
    data = SmokeDataset(folder, guide=card.guide_name, split="test")
    pairs = []
    for which, group in enumerate(data.groups):
        count = len(group.samples) // 2
        for row in np.linspace(0, count - 1, num=min(-(-most_pairs // len(data.groups)), count)).astype(int):
            batch = data.pair(which, int(row))
            truth = encode_lightmap(batch.target, scale=card.scale, emissive_scale=card.emissive_scale).numpy()
            pairs.append(Pair(batch.guide.numpy(), truth[:, : len(data.target_channels)]))
    return pairs


def judge(result: Measurement, files: Files, pictures: list[Pair]) -> None:
    """Squared errors of every file over the test pictures."""
    net = EngineNet(files.net).eval()
    from_truth: dict[str, list[float]] = {}
    from_torch: dict[str, list[float]] = {}
    for pair in pictures:
        channels, (height, width) = pair.truth.shape[1], pair.guide.shape[2:]
        with torch.inference_mode():
            expected = net(torch.from_numpy(pair.guide)).numpy()[:, :channels]
        from_truth.setdefault("torch", []).append(squared_error(expected, pair.truth))
        for name, predictor in files.predictors(width, height).items():
            answer = predictor.encoded(pair.guide)[:, :channels]
            from_truth.setdefault(name, []).append(squared_error(answer, pair.truth))
            from_torch.setdefault(name, []).append(squared_error(answer, expected))
    decibels = {name: psnr_of_mse(float(np.mean(errors))) for name, errors in from_truth.items()}
    result.add("torch fp32, PSNR", decibels["torch"], "dB")
    for name, errors in from_torch.items():
        most = MOST_LOST_DB.get(name.split()[1])
        result.add(f"{name}, PSNR lost", decibels["torch"] - decibels[name], "dB", at_most=most)
        result.add(f"{name}, PSNR against torch", psnr_of_mse(float(np.mean(errors))), "dB")
    width, height = pictures[0].truth.shape[3], pictures[0].truth.shape[2]
    paths = {f"engine {p}": files.engine(p, width, height) for p in ENGINE}
    for name, path in (paths | {f"ort {p}": path for p, path in files.ort.items()}).items():
        result.add(f"{name}, size of the file", path.stat().st_size / 1e6, "MB")


def squared_error(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.mean((a - b) ** 2, dtype=np.float64))


def time_size(result: Measurement, files: Files, size: int) -> None:
    """Milliseconds of one picture by every file, and what int8 gains."""
    shape = (1, len(files.card.guide_channels), size, size)
    guide = np.random.default_rng(0).random(shape, dtype=np.float32)
    predictors = files.predictors(size, size)
    taken: dict[str, list[float]] = {name: [] for name in predictors}
    for repetition in range(1 + result.repetitions):
        for name, predictor in predictors.items():
            start = time.perf_counter()
            predictor.encoded(guide)
            if repetition:  # the first run of each allocates
                taken[name].append(time.perf_counter() - start)
    seconds = {name: statistics.median(times) for name, times in taken.items()}
    for name in predictors:
        result.add(f"{name}, {size} px", 1e3 * seconds[name], "ms")
    result.add(f"ort fp32 / int8, {size} px", seconds["ort fp32"] / seconds["ort int8"], "x")


def told(result: Measurement) -> None:
    """Where int8 is worth its loss in time alone."""
    gains = {row["name"]: row["value"] for row in result.rows if row["unit"] == "x"}
    wins = [name.split(", ")[1] for name, gain in gains.items() if gain >= FASTER]
    print(f"int8 is faster than float32 at: {', '.join(wins) or 'none of the sizes'}")


if __name__ == "__main__":
    sys.exit(main())
