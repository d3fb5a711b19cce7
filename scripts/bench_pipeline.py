"""Milliseconds of every stage on one device: simulate, guide, reference, the shipped net, ONNX Runtime, shade.

python scripts/bench_pipeline.py --size 256 --json bench.json
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
import warp as wp
from measurement import Measurement, median_seconds, parser

from sixway.core.config import load_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import Medium
from sixway.guide.config import GuideConfig, stored_guide
from sixway.guide.march import GuideMarcher
from sixway.inference.onnx import export_onnx
from sixway.inference.predict import SHIPPED_NET, OnnxPredictor, TorchPredictor, predict
from sixway.models.card import load_net
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.shading.compose import shade
from sixway.shading.light import DirectionalLight
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

SCENARIO = Path(__file__).parents[1] / "configs/sim/jet.yaml"
SHIPPED = "of the shipped net"
GUIDES = {
    "paper": GuideConfig(),
    "six": GuideConfig(lights=DIRECTIONS, sum_lights=False),
    "swept": GuideConfig(lights=DIRECTIONS, sum_lights=False, lighting="sweep", scatter_iterations=1, pixel_samples=16),
}


def main() -> int:
    options = parser("Milliseconds of every stage on one device.")
    options.add_argument("--device", default="cpu", help="cpu or cuda (default: cpu)")
    options.add_argument("--size", type=int, default=512, help="image size in px (default: 512)")
    chosen = options.parse_args()
    size, repetitions = (64, 3) if chosen.quick else (chosen.size, 5)
    device = chosen.device
    wp.config.log_level = wp.LOG_WARNING
    net, card = load_net(SHIPPED_NET)
    about = {"device": device, "size_px": size, "scenario": SCENARIO.name, "guide": card.guide}
    result = Measurement(about, repetitions)

    def timed(name: str, work, wait) -> None:
        result.add(name, 1e3 * median_seconds(work, repetitions=repetitions, wait=wait), "ms")

    def wait_torch() -> None:
        if device.startswith("cuda"):
            torch.cuda.synchronize()

    solver = SmokeSolver(load_config(ScenarioConfig, SCENARIO, ["resolution=tiny"]), device=device)
    for _ in range(10 if chosen.quick else 40):
        solver.advance()
    frame = solver.frame()
    timed("simulate, a frame", solver.advance, wp.synchronize)
    camera = Camera.around(frame.grid, yaw_deg=30.0, margin=0.8, width_px=size, height_px=size)
    medium = Medium(extinction_per_m=40.0)
    guides = {}
    own = stored_guide(card.guide, source="the shipped net's guide")
    for name, config in {**GUIDES, SHIPPED: own}.items():
        marcher = GuideMarcher(config, medium, device=device, threads=torch.get_num_threads())
        guides[name] = marcher.march(frame, camera, seed=0)
        timed(f"guide {name}", lambda m=marcher: m.march(frame, camera, seed=0), wp.synchronize)
    tracer = LightmapTracer(ReferenceConfig(samples=4), medium, device="cuda" if device.startswith("cuda") else "cpu")
    timed(
        f"reference, {tracer.method}, paper bounces, 4 samples", lambda: tracer.trace(frame, camera, seed=0), wait_torch
    )

    guide = guides[SHIPPED]
    with tempfile.TemporaryDirectory() as folder:
        export_onnx(net, card, Path(folder) / "net.onnx", width_px=size, height_px=size)
        onnx = OnnxPredictor(Path(folder) / "net.onnx", device=device)
        timed("net, ONNX Runtime", lambda: predict(onnx, guide), wait_torch)
    torch_net = TorchPredictor(net, card, device=device)
    timed("net, torch", lambda: predict(torch_net, guide), wait_torch)
    lightmap = predict(torch_net, guide)
    lights = [DirectionalLight.parse(text) for text in ("right", "0:1:1", "back")]
    timed("shade, 3 lights, NumPy", lambda: shade(lightmap, lights), wait_torch)
    result.add("smoke in the picture", float(np.mean(lightmap["alpha"] > 0.02)), "of its pixels")
    return result.finish(chosen.json)


if __name__ == "__main__":
    sys.exit(main())
