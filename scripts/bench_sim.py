"""Speed of the smoke simulation, beside the machine's copy bandwidth and, if asked, beside Autodesk's XLB.

python scripts/bench_sim.py --json sim.json
python scripts/bench_sim.py --xlb /path/to/venv/bin/python    # a venv with xlb==0.3.1 and warp-lang==1.10.1

MLUPS: million lattice updates per second, of a closed box with a block in its middle, Smagorinsky's eddy viscosity
on. Frames: a whole frame of the jet, and what carrying heat besides costs. Bound: what the machine would reach if it
only copied the bytes of an update (populations in and out, force and kind in), by a copy within as much memory,
timed in turn with the steps. Medians.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import get_args

import numpy as np
import warp as wp
from measurement import Measurement, parser
from pydantic import ValidationError

from sixway.core.config import load_config
from sixway.sim.flow.collision import Model
from sixway.sim.flow.flow import Flow, FlowConfig
from sixway.sim.flow.generated.pieces import Streaming
from sixway.sim.flow.lattice import LatticeName, lattice_named
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

TARGETS_MLUPS = {"two_grids": 60.0, "in_place": 120.0}  # D3Q19, 64^3, on two idle cores
FRAME_MS, FURTHER_FIELD_MS = 250.0, 90.0  # 64^3 cells, 128^3 voxels, on two idle cores
JET = Path(__file__).parents[1] / "configs/sim/jet.yaml"
XLB_SCRIPT = Path(__file__).with_name("bench_xlb.py")


def main() -> int:
    options = parser("Speed of the smoke simulation.")
    options.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="default: all")
    options.add_argument("--device", default="cpu", help="cpu or cuda")
    options.add_argument("--xlb", type=Path, help="python of a venv with xlb==0.3.1 and warp-lang==1.10.1")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    repetitions = 3 if chosen.quick else 7
    config = {
        "device": chosen.device,
        "threads": chosen.threads,
        "load_before": os.getloadavg()[0],
        "quick": chosen.quick,
    }
    result = Measurement(config, repetitions)
    for cells in (32,) if chosen.quick else (64, 96):
        for lattice in get_args(LatticeName):
            for model in get_args(Model):
                for streaming in get_args(Streaming):
                    try:
                        flow_config = FlowConfig(lattice=lattice, model=model, streaming=streaming)
                    except ValidationError:
                        continue  # a model that needs the other lattice
                    flow = stirred_flow(flow_config, cells, chosen.device, chosen.threads)
                    time_flow(result, flow, cells, threads=chosen.threads, repetitions=repetitions)
        if chosen.xlb:
            time_xlb(result, chosen.xlb, cells, quick=chosen.quick)
    time_frames(result, (16, 32) if chosen.quick else (32, 64, 96), chosen.device, chosen.threads, repetitions)
    return result.finish(chosen.json)


def time_frames(result: Measurement, sizes: tuple[int, ...], device: str, threads: int, repetitions: int) -> None:
    """Whole frames of ten lattice steps and one advection, smoke voxels half as wide, once the jet fills its box."""
    for cells in sizes:
        seconds = {}
        for fields, settings in (("density", ()), ("density and temperature", ("inlets.0.temperature_k=20.0",))):
            pace = [f"frames_per_second={float(cells)}", f"resolution={{cells: {cells}, refinement: 2}}"]
            solver = SmokeSolver(load_config(ScenarioConfig, JET, [*pace, *settings]), device=device, threads=threads)
            for _ in range(2 * cells):  # two seconds
                solver.advance()
            times = [seconds_of(solver.advance, wp.get_device(device)) for _ in range(3 * repetitions)]
            seconds[fields] = statistics.median(times)
        one, two = seconds.values()
        judged = cells == 64 and wp.get_device(device).is_cpu
        name = f"frame of {cells}^3 cells, {2 * cells}^3 voxels"
        result.add(f"{name}, density", 1e3 * one, "ms", at_most=FRAME_MS if judged else None)
        result.add(f"{name}, density: a voxel", 1e9 * one / (2 * cells) ** 3, "ns")
        result.add(f"{name}, a further field", 1e3 * (two - one), "ms", at_most=FURTHER_FIELD_MS if judged else None)


def time_flow(result: Measurement, flow: Flow, cells: int, *, threads: int, repetitions: int) -> None:
    config, device = flow.config, flow.kind.device
    populations = len(lattice_named(config.lattice).weights)
    footprint = 4 * populations * cells**3 * (2 if config.streaming == "two_grids" else 1)
    bytes_an_update = 4 * (2 * populations + 3 + 1)
    copy = parallel_copy(footprint, threads) if device.is_cpu else device_copy(footprint, device)
    steps = max(2, 20 * 64**3 // cells**3)
    flow.step(2)
    copy()
    rates, bandwidths = [], []
    for _ in range(repetitions):
        bandwidths.append(4 * footprint / seconds_of(lambda: [copy() for _ in range(4)], device))
        rates.append(cells**3 * steps / seconds_of(lambda: flow.step(steps), device))
    mlups, bandwidth = statistics.median(rates) / 1e6, statistics.median(bandwidths)
    judged = device.is_cpu and cells == 64 and config.lattice == "D3Q19"
    name = f"{cells}^3 {config.lattice} {config.model} {config.streaming}"
    result.add(name, mlups, "MLUPS", at_least=TARGETS_MLUPS[config.streaming] if judged else None)
    result.add(f"{name}: best of {repetitions}", max(rates) / 1e6, "MLUPS")
    result.add(f"{name}: {bytes_an_update} B an update, copied at", bandwidth / 1e9, "GB/s")
    result.add(f"{name}: share of the bound", 1e6 * mlups * bytes_an_update / bandwidth, "of 1")


def stirred_flow(config: FlowConfig, cells: int, device: str, threads: int) -> Flow:
    flow = Flow(config, shape_zyx=(cells,) * 3, viscosity=0.01, device=device, threads=threads)
    solid = np.zeros(flow.kind.shape, dtype=np.int32)
    solid[(slice(cells // 2 - cells // 16, cells // 2 + cells // 16),) * 3] = 1
    walls = wp.zeros(solid.shape, dtype=wp.vec3, device=device)
    flow.set_solid(wp.array(solid, dtype=wp.int32, device=device), walls)
    flow.set_flow(velocity=np.random.default_rng(0).uniform(-0.05, 0.05, (cells,) * 3 + (3,)))
    return flow


def parallel_copy(footprint: int, threads: int) -> Callable[[], object]:
    """Copies one half of `footprint` bytes into the other half: reads and writes `footprint` bytes in all."""
    source, target = np.ones(footprint // 2, dtype=np.uint8), np.zeros(footprint // 2, dtype=np.uint8)
    pieces = list(zip(np.array_split(target, threads), np.array_split(source, threads), strict=True))
    pool = ThreadPoolExecutor(threads)
    return lambda: list(pool.map(lambda piece: np.copyto(*piece), pieces))


def device_copy(footprint: int, device: wp.Device) -> Callable[[], object]:
    source = wp.zeros(footprint // 2, dtype=wp.uint8, device=device)
    target = wp.zeros_like(source)
    return lambda: wp.copy(target, source)


def seconds_of(work: Callable[[], object], device: wp.Device) -> float:
    wp.synchronize_device(device)
    start = time.perf_counter()
    work()
    wp.synchronize_device(device)
    return time.perf_counter() - start


def time_xlb(result: Measurement, python: Path, cells: int, *, quick: bool) -> None:
    for lattice in get_args(LatticeName):
        command = [str(python), str(XLB_SCRIPT), str(cells), lattice, "3" if quick else "6", "3"]
        told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        for backend, mlups in json.loads(told.splitlines()[-1]).items():
            result.add(f"{cells}^3 {lattice} XLB 0.3.1 on {backend}", mlups, "MLUPS")


if __name__ == "__main__":
    sys.exit(main())
