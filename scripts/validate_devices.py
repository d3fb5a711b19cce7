"""CPU = CUDA for every kernel and net: the same inputs on both, largest difference against a bound.

python scripts/validate_devices.py --json devices.json

Without a CUDA device it says so and ends well: there is nothing to compare.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
import warp as wp
from bench_pipeline import GUIDES, SCENARIO
from measurement import Measurement, parser

from sixway.core.config import load_config
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.guide.march import GuideMarcher
from sixway.guide.motion import project_motion
from sixway.models.unet import SixWayUNet, UNetConfig
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver


def simulated(device: str) -> DensityFrame:
    solver = SmokeSolver(load_config(ScenarioConfig, SCENARIO, ["resolution=tiny"]), device=device)
    for _ in range(12):  # later, turbulence makes any last bit grow
        solver.advance()
    return solver.frame()


def onnx_answer(provider: str, guide: torch.Tensor, net: SixWayUNet) -> np.ndarray:
    import onnxruntime

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "net.onnx"
        torch.onnx.export(net, (guide,), path, dynamo=False, opset_version=15, input_names=["guide"])
        answer: np.ndarray = onnxruntime.InferenceSession(str(path), providers=[provider]).run(
            None, {"guide": guide.numpy()}
        )[0]
    return answer


def main() -> int:
    options = parser(__doc__ or "").parse_args()
    wp.config.log_level = wp.LOG_WARNING
    if not (wp.is_cuda_available() and torch.cuda.is_available()):
        print("no CUDA device: nothing to compare, skipped")
        return 0
    result = Measurement({"scenario": SCENARIO.name}, repetitions=1)
    frame, other = simulated("cpu"), simulated("cuda")
    result.add("simulator: density", float(np.abs(frame.density - other.density).max()), "", at_most=1e-2)
    medium = Medium(extinction_per_m=40.0)
    camera = Camera.around(frame.grid, yaw_deg=30.0, width_px=256, height_px=256)
    for name, config in GUIDES.items():
        cpu, cuda = (GuideMarcher(config, medium, device=d).march(frame, camera, seed=1).image for d in ("cpu", "cuda"))
        result.add(f"guide {name}, 99.9th percentile", float(np.percentile(np.abs(cpu - cuda), 99.9)), "", at_most=1e-4)
    cpu, cuda = (project_motion(frame, camera, medium, frame_s=0.05, device=d) for d in ("cpu", "cuda"))
    result.add("motion", float(np.percentile(np.abs(cpu - cuda), 99.9)), "px", at_most=1e-3)
    small = camera.resized(64, 64)
    cpu, cuda = (
        LightmapTracer(ReferenceConfig(bounces="single"), medium, device=d).trace(frame, small, seed=1).image
        for d in ("cpu", "cuda")
    )
    result.add("reference, single", float(np.abs(cpu - cuda).max()), "", at_most=1e-3)
    net = SixWayUNet(UNetConfig(), guide_channels=("in_scatter", "transmittance", "depth"), guide_scale=1.0).eval()
    guide = torch.rand(1, 3, 256, 256)
    with torch.inference_mode():
        cpu_answer, cuda_answer = net(guide), net.cuda()(guide.cuda()).cpu()
    result.add("net, torch", float((cpu_answer - cuda_answer).abs().max()), "", at_most=1e-3)
    net = net.cpu()
    on_cuda = onnx_answer("CUDAExecutionProvider", guide, net)
    result.add("net, ONNX Runtime", float(np.abs(on_cuda - cpu_answer.numpy()).max()), "", at_most=1e-3)
    return result.finish(options.json)


if __name__ == "__main__":
    sys.exit(main())
