"""How fast the net is, and how much sooner guide, net and shading are as good as a renderer.

python scripts/bench_inference.py runs/cpu --json inference.json

The net alone: ONNX Runtime and torch in turn, and the share of the arithmetic that this machine reaches in its best
convolution or matrix product, measured between them. End to end: a new frame of smoke in memory to a picture under
three lights, by guide + net, by the `cached` renderer and by Mitsuba's volpath, in turn. PSNR of the six maps in sRGB
is against an independent reference of method `path` in two halves A and B: the mean of (x - A)(x - B) is the squared
error of x without the reference's own noise.
"""

import copy
import itertools
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import warp as wp
from bench_reference import Reference
from measurement import Measurement, parser

from sixway.core.color import encode_srgb
from sixway.core.config import load_config
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.inference.bake import LightmapBaker
from sixway.inference.onnx import export_onnx
from sixway.inference.predict import OnnxPredictor, Predictor
from sixway.metrics.psnr import psnr_of_mse
from sixway.models.card import NetCard, load_net
from sixway.models.cost import gmac
from sixway.models.unet import SixWayUNet
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.reference.variant import use_variant
from sixway.shading.compose import shade
from sixway.shading.light import DirectionalLight
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

SCENARIO = Path(__file__).parents[1] / "configs/sim/jet.yaml"
UNSEEN_SEED = 1000
PRECISIONS = {"fp32": torch.float32, "bf16": torch.bfloat16}
ONNX, NET = "ONNX Runtime fp32", "guide + net"
LIGHTS = tuple(DirectionalLight.parse(text) for text in ("right", "0:1:1", "back"))
NORMAL = "as it is"
CACHED = {
    NORMAL: ReferenceConfig(),
    **{f"{n} samples": ReferenceConfig(samples=n) for n in (4, 2)},
    "1 sample": ReferenceConfig(samples=1),
    "1 sample, coarsest grid": ReferenceConfig(samples=1, source_optical_depth=10.0),
    "single scattering": ReferenceConfig(bounces="single"),
}
"""From the setting that datasets are made with to the coarsest. Coarser densities are no quicker: `cached` divides
voxels that are too thick."""
BOUNCES = CACHED[NORMAL].bounces
STOCK_SAMPLES = {128: 64, 256: 16}  # about as long at every size


def main() -> int:
    options = parser((__doc__ or "").splitlines()[0])
    options.add_argument("net", type=Path, help="run folder, or an .onnx file (its own size, no torch)")
    options.add_argument("--scenario", type=Path, default=SCENARIO, help="smoke to look at, without obstacles")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    quick = chosen.quick
    about = {
        "net": str(chosen.net),
        "scenario": chosen.scenario.name,
        "bounces": BOUNCES,
        "threads": torch.get_num_threads(),
        "cores": os.cpu_count(),
        "load_before": os.getloadavg()[0],
    }
    result = Measurement(about, repetitions=3)
    with tempfile.TemporaryDirectory() as folder:
        nets = Nets.open(chosen.net, Path(folder))
        for size in nets.sizes((128, 256) if quick else (128, 256, 512)):
            time_net(result, nets, size, repetitions=5 if quick else 20)
        if use_variant("cpu").startswith("scalar"):
            print("Mitsuba runs in scalar code only: no renderer to compare with, left out")
            return result.finish(chosen.json)
        frame = smoke(chosen.scenario, quick=quick)
        for size in nets.sizes((64,) if quick else (128, 256)):
            against_renderers(result, nets, frame, size, quick=quick)
    return result.finish(chosen.json)


@dataclass(frozen=True)
class Nets:
    """One net: its card, as ONNX at any size, and as torch, which an .onnx file is not."""

    card: NetCard
    torch: SixWayUNet | None
    path: Path
    folder: Path

    @classmethod
    def open(cls, path: Path, folder: Path) -> "Nets":
        if path.suffix == ".onnx":
            return cls(OnnxPredictor(path, device="cpu").card, None, path, folder)
        net, card = load_net(path)
        return cls(card, net, path, folder)

    def sizes(self, wanted: tuple[int, ...]) -> tuple[int, ...]:
        return wanted if self.torch is not None else (self.card.width_px,)

    def onnx(self, size: int) -> OnnxPredictor:
        if self.torch is None:
            return OnnxPredictor(self.path, device="cpu")
        file = self.folder / f"net_{size}.onnx"
        if not file.exists():
            export_onnx(self.torch, self.card, file, width_px=size, height_px=size)
        return OnnxPredictor(file, device="cpu")


def smoke(scenario: Path, *, quick: bool) -> DensityFrame:
    """A frame of a simulation that no dataset has: its seed is none of theirs."""
    resolution = ["resolution=tiny"] if quick else []
    solver = SmokeSolver(load_config(ScenarioConfig, scenario, [f"seed={UNSEEN_SEED}", *resolution]), device="cpu")
    for _ in range(30 if quick else 60):
        solver.advance()
    return solver.frame()


@dataclass(frozen=True)
class Taken:
    """Medians. cpu_seconds: of all threads; on a busy machine the steadier figure, but waiting threads count."""

    seconds: float
    cpu_seconds: float


def medians_in_turn(
    works: Mapping[str, Callable[[], object]], *, repetitions: int, judge: Callable[[str], None] = lambda name: None
) -> dict[str, Taken]:
    """Time of each, one after the other again and again, so that other load slows all alike.

    judge: called with the name after every run, outside its time.
    """
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in works}
    for work in works.values():  # caches, compilers
        work()
    for _ in range(repetitions):
        for name, work in works.items():
            start, cpu = time.perf_counter(), time.process_time()
            work()
            taken[name].append((time.perf_counter() - start, time.process_time() - cpu))
            judge(name)
    return {name: Taken(*map(statistics.median, zip(*times, strict=True))) for name, times in taken.items()}


# the net alone


@torch.inference_mode()
def time_net(result: Measurement, nets: Nets, size: int, *, repetitions: int) -> None:
    """Milliseconds of one picture by every runtime, and what share of the machine's arithmetic that is."""
    channels = len(nets.card.guide_channels)
    guide = torch.rand(1, channels, size, size, generator=torch.Generator().manual_seed(0))
    onnx = nets.onnx(size)
    runtimes: dict[str, Callable[[], object]] = {ONNX: lambda: onnx.encoded(guide.numpy())}
    if nets.torch is not None:
        runtimes |= torch_runtimes(nets.torch.eval(), guide)
    dense = {kind: dense_work(kind) for kind in PRECISIONS}
    works = runtimes | {f"{kind} {name}": work for kind, found in dense.items() for name, (work, _) in found.items()}
    taken = medians_in_turn(works, repetitions=repetitions)
    seconds = {name: times.seconds for name, times in taken.items()}
    for name in runtimes:
        result.add(f"net, {size}^2, {name}", 1e3 * seconds[name], "ms")
    if nets.torch is None:
        return
    cost = gmac(nets.torch, size, size)
    result.add(f"net, {size}^2", cost, "GMAC")
    peak = {k: max(n / seconds[f"{k} {name}"] for name, (_, n) in found.items()) for k, found in dense.items()}
    for kind in PRECISIONS:
        result.add(f"net, {size}^2, {kind} peak of the machine meanwhile", peak[kind], "GMAC/s")
    for name in runtimes:
        kind = "bf16" if "bf16" in name else "fp32"
        share = cost / seconds[name] / peak[kind]
        result.add(f"net, {size}^2, {name}, share of the {kind} peak", 100.0 * share, "%")
    fastest_torch = min(seconds[name] for name in runtimes if name.startswith("torch"))
    result.add(f"net, {size}^2, fastest torch / ONNX Runtime", fastest_torch / seconds[ONNX], "x")


def torch_runtimes(net: SixWayUNet, guide: torch.Tensor) -> dict[str, Callable[[], object]]:
    plain = copy.deepcopy(net).to(memory_format=torch.contiguous_format)
    last = copy.deepcopy(net).to(memory_format=torch.channels_last)
    guide_last = guide.to(memory_format=torch.channels_last)

    def in_bf16() -> torch.Tensor:
        with torch.autocast("cpu", torch.bfloat16):
            return last(guide_last)

    return {
        "torch fp32": lambda: plain(guide),
        "torch fp32 channels_last": lambda: last(guide_last),
        "torch bf16 channels_last": in_bf16,
    }


def dense_work(kind: str) -> dict[str, tuple[Callable[[], object], float]]:
    """What a machine computes as fast as it can, with its GMAC."""
    dtype = PRECISIONS[kind]
    size, channels, pixels = 1024, 128, 96
    matrix = torch.ones(size, size, dtype=dtype)
    picture = torch.ones(1, channels, pixels, pixels, dtype=dtype).to(memory_format=torch.channels_last)
    layer = torch.nn.Conv2d(channels, channels, 3, padding=1, dtype=dtype).to(memory_format=torch.channels_last)
    return {
        "product of matrices": (lambda: matrix @ matrix, size**3 / 1e9),
        "3x3 convolution": (lambda: layer(picture), 9 * channels**2 * pixels**2 / 1e9),
    }


# end to end


@dataclass(frozen=True)
class Scene:
    """A frame, a camera and the truth they show: two halves, sRGB of maps times scale."""

    frame: DensityFrame
    camera: Camera
    medium: Medium
    scale: float
    first: np.ndarray
    second: np.ndarray

    @classmethod
    def traced(cls, frame: DensityFrame, card: NetCard, size: int, *, samples: int, yaw_deg: float = 30.0) -> "Scene":
        camera = Camera.around(frame.grid, yaw_deg=yaw_deg, margin=0.8, width_px=size, height_px=size)
        medium = Medium(**card.medium)
        truth = Reference.traced(frame, camera, medium, BOUNCES, samples)
        first, second = (encode_srgb(half * np.float32(card.scale)) for half in (truth.first, truth.second))
        return cls(frame, camera, medium, card.scale, first, second)

    def squared_error(self, maps: np.ndarray) -> float:
        encoded = encode_srgb(maps * np.float32(self.scale))
        return max(float(np.mean((encoded - self.first) * (encoded - self.second), dtype=np.float64)), 1e-9)


class Shaded:
    """A way from smoke to a picture; keeps the last lightmap, to be judged."""

    def __init__(self, scene: Scene, bake: Callable[[DensityFrame, int], SixWayLightmap]) -> None:
        self._bake = bake
        self._seeds = itertools.count(1)
        self._scene = scene
        self.squared_errors: list[float] = []

    def __call__(self) -> np.ndarray:
        seed = next(self._seeds)
        frame = replace(self._scene.frame, time_s=float(seed))  # one not seen before: nothing is kept from the last
        self.lightmap = self._bake(frame, seed)
        return shade(self.lightmap, LIGHTS)

    def judge(self) -> None:
        self.squared_errors.append(self._scene.squared_error(self.lightmap.maps))

    @property
    def squared_error(self) -> float:
        """Median over the runs."""
        return statistics.median(self.squared_errors)


def by_net(scene: Scene, predictor: Predictor) -> Shaded:
    baker = LightmapBaker(predictor, extinction_per_m=scene.medium.extinction_per_m, device="cpu")
    return Shaded(scene, lambda frame, seed: baker.bake(frame, scene.camera, seed=seed))


def by_tracer(scene: Scene, config: ReferenceConfig) -> Shaded:
    tracer = LightmapTracer(config, scene.medium, device="cpu")
    return Shaded(scene, lambda frame, seed: tracer.trace(frame, scene.camera, seed=seed))


def judged_in_turn(ways: Mapping[str, Shaded], *, repetitions: int) -> dict[str, Taken]:
    """Time of each; every run counts for its squared error."""
    return medians_in_turn(ways, repetitions=repetitions, judge=lambda name: ways[name].judge())


def against_renderers(result: Measurement, nets: Nets, frame: DensityFrame, size: int, *, quick: bool) -> None:
    scene = Scene.traced(frame, nets.card, size, samples=256 if quick else 2048)
    ways = {NET: by_net(scene, nets.onnx(size))}
    ways |= {f"cached, {name}": by_tracer(scene, config) for name, config in CACHED.items()}
    taken = judged_in_turn(ways, repetitions=result.repetitions)
    error = {name: way.squared_error for name, way in ways.items()}
    for name in ways:
        result.add(f"{size}^2, {name}, with shading", 1e3 * taken[name].seconds, "ms")
        result.add(f"{size}^2, {name}", psnr_of_mse(error[name]), "dB")
    normal = f"cached, {NORMAL}"
    add_ratio(result, f"{size}^2, {normal} / {NET}", taken[normal], taken[NET], at_least=None if quick else 20.0)
    as_good = [name for name in ways if name != NET and error[name] <= error[NET]]
    if as_good:
        name = min(as_good, key=lambda n: taken[n].seconds)
        add_ratio(result, f"{size}^2, at matched PSNR, {name} / {NET}", taken[name], taken[NET])
    against_stock(result, scene, ways[NET], size, quick=quick)


def add_ratio(
    result: Measurement, label: str, slow: Taken, quick: Taken, *, factor: float = 1.0, at_least: float | None = None
) -> None:
    result.add(f"{label}, time", factor * slow.seconds / quick.seconds, "x", at_least=at_least)
    result.add(f"{label}, CPU time", factor * slow.cpu_seconds / quick.cpu_seconds, "x")


def against_stock(result: Measurement, scene: Scene, net: Shaded, size: int, *, quick: bool) -> None:
    """Stock renders are as noisy as time allows: their time to the net's error is extrapolated, not measured."""
    samples = 16 if quick else STOCK_SAMPLES.get(size, 16)
    few, many = f"stock, {samples} paths a light", f"stock, {4 * samples} paths a light"
    ways = {
        NET: net,
        few: by_tracer(scene, ReferenceConfig(method="stock", samples=samples)),
        many: by_tracer(scene, ReferenceConfig(method="stock", samples=4 * samples)),
    }
    taken = judged_in_turn(ways, repetitions=1 if quick else 3)
    error = {name: way.squared_error for name, way in ways.items()}
    for name in (few, many):
        result.add(f"{size}^2, {name}, with shading", taken[name].seconds, "s")
        result.add(f"{size}^2, {name}", psnr_of_mse(error[name]), "dB")
    fall = np.log(error[few] / error[many]) / np.log(4.0)
    result.add(f"{size}^2, stock, squared error falls as paths to the power of", -float(fall), "")
    # unbiased: its squared error falls as 1 / paths, hence 1 / time
    factor = error[many] / error[NET]
    needed = factor * taken[many].seconds
    result.add(f"{size}^2, stock, extrapolated by 1 / paths to the PSNR of {NET}", needed, "s")
    label = f"{size}^2, at matched PSNR (extrapolated), stock / {NET}"
    add_ratio(result, label, taken[many], taken[NET], factor=factor, at_least=None if quick else 1000.0)


if __name__ == "__main__":
    sys.exit(main())
