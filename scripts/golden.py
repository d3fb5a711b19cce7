"""Golden comparison: what every stage answers at fixed seeds, to be held against another commit on the same machine.

python scripts/golden.py --out old.npz                  # at the old commit
python scripts/golden.py --against old.npz              # at the new one: every array, byte by byte
python scripts/golden.py --digests tests/golden/digests.json   # the few numbers that tests/test_golden.py holds

On one machine a change that is no change of numerics answers the same bytes. Compilers and processors differ, so the
committed digests are compared within tolerances.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import warp as wp

from sixway.core.config import load_config, parse_config
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.core.store import read_json_lines, write_json
from sixway.extras.moments import make_flow
from sixway.generate import main as generate
from sixway.guide.config import GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.inference.bake import LightmapBaker
from sixway.inference.predict import SHIPPED_NET, load_predictor
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver
from sixway.train import main as train
from sixway.training.log import METRICS
from sixway.volumes.npz import read_npz

ROOT = Path(__file__).parents[1]

FLOWS = {
    "bgk": ["flow.model=bgk"],
    "regularised": ["flow.model=regularised"],
    "regularised_two_grids": ["flow.model=regularised", "flow.streaming=two_grids"],
    "third_order": ["flow.model=third_order", "flow.lattice=D3Q27"],
    "third_order_two_grids": ["flow.model=third_order", "flow.lattice=D3Q27", "flow.streaming=two_grids"],
    "moments": [
        "flow.model=third_order",
        "flow.lattice=D3Q27",
        "flow.streaming=two_grids",
        "flow.encoding=moments",
    ],
}
"""Overrides of a scenario for each collision, streaming and encoding."""

GUIDES = {
    "paper": {"lights": "front_tb"},
    "paper_literal": {"lights": "front_tb", "weight": "paper_literal", "step_voxels": 2.0},
    "world_up": {"lights": "front_tb", "vertical": "world_up"},
    "omega_cross_z": {"lights": "front_tb", "vertical": "omega_cross_z"},
    "six": {"lights": "all", "sum_lights": False},
    "six_mip": {"lights": "all", "sum_lights": False, "mip": 2, "pixel_samples": 4},
    "six_emission": {"lights": "all", "sum_lights": False, "emission": True, "pixel_samples": 4},
    "six_even": {"lights": "all", "sum_lights": False, "jitter": False},
    "swept": {"lights": "all", "sum_lights": False, "lighting": "sweep", "light_grid": 32},
    "swept_even": {"lights": "all", "sum_lights": False, "lighting": "sweep", "light_grid": 32, "jitter": False},
    "rich": {
        "lights": "all",
        "sum_lights": False,
        "lighting": "sweep",
        "light_grid": 96,
        "light_samples": 24,
        "scatter_iterations": 1,
        "pixel_samples": 16,
        "emission": True,
    },
}
"""One guide of each kind; `_even` are those without jitter."""

REFERENCES = {
    "cached_single": {"method": "cached", "bounces": "single", "samples": 4},
    "cached_paper": {"method": "cached", "bounces": "paper", "samples": 4},
    "cached_multi": {"method": "cached", "bounces": "multi", "samples": 4},
    "path_paper": {"method": "path", "bounces": "paper", "samples": 16},
}

_DATASET = """\
name: golden
simulations:
  - {name: jet, split: train, scenario: SCENARIO, set: [seed=1, frames=8, RESOLUTION]}
  - {name: jet_val, split: val, scenario: SCENARIO, set: [seed=2, frames=8, RESOLUTION]}
pairs_per_simulation: 2
views: [{yaws_deg: [0, 30], margin: 0.75, width_px: 32, height_px: 24}]
medium: {extinction_per_m: 40.0}
guides: {six: {lights: all, sum_lights: false}}
reference: {samples: 2}
"""

_TRAINING = """\
data: DATA
guide: six
net: {widths: [8, 12], adapter_width: 8, adapter_blocks: 1}
train: {steps: 20, pairs_per_batch: 2, lr: 2e-3, warmup_steps: 5, ema: 0.9, log_every: 1, validate_every: 10}
loss: {mse: 1.0, perceptual: 0.001, features: gradients, flow: 0.001, estimator: lucas_kanade}
"""


def simulated(name: str, overrides: list[str], frames: int = 6) -> DensityFrame:
    """A frame of a shipped scenario on 16 cells."""
    path = ROOT / "configs" / "sim" / f"{name}.yaml"
    resolution = "resolution={cells: 16, refinement: 2}"
    solver = SmokeSolver(load_config(ScenarioConfig, path, [resolution, *overrides]), device="cpu", make_flow=make_flow)
    for _ in range(frames):
        solver.advance()
    return solver.frame()


def flows() -> Iterator[tuple[str, np.ndarray]]:
    """Simulated frames: one of each collision, a body that moves, fire."""
    for name, overrides in FLOWS.items():
        frame = simulated("jet_sphere", overrides)
        yield f"sim/{name}/density", frame.density
        assert frame.velocity_m_s is not None
        yield f"sim/{name}/velocity", frame.velocity_m_s
    yield "sim/moving/density", simulated("jet_moving_sphere", []).density
    burning = simulated("flame", [])
    assert burning.emission is not None
    yield "sim/burning/density", burning.density
    yield "sim/burning/emission", burning.emission


def pictures() -> Iterator[tuple[str, np.ndarray]]:
    """Guides and references of the jet of the tests and of a flame."""
    medium = Medium(extinction_per_m=40.0)
    frames = {"jet": read_npz(ROOT / "tests" / "data" / "jet.npz"), "flame": simulated("flame", [], frames=16)}
    for volume, frame in frames.items():
        camera = Camera.around(frame.grid, yaw_deg=25.0, pitch_deg=10.0, margin=0.8, width_px=40, height_px=32)
        for name, options in GUIDES.items():
            config = parse_config(GuideConfig, options, source=name)
            guide = GuideMarcher(config, medium, device="cpu").march(frame, camera, seed=3)
            yield f"guide/{volume}/{name}", guide.image
            yield f"guide/{volume}/{name}/depth_m", guide.depth_m
        small = camera.resized(20, 16)
        for name, options in REFERENCES.items():
            config = parse_config(ReferenceConfig, options, source=name)
            yield f"reference/{volume}/{name}", LightmapTracer(config, medium).trace(frame, small, seed=3).image
    baker = LightmapBaker(load_predictor(SHIPPED_NET, device="cpu"), extinction_per_m=40.0, device="cpu")
    frame = frames["jet"]
    camera = Camera.around(frame.grid, yaw_deg=25.0, margin=0.8, width_px=64, height_px=64)
    yield "net/jet", baker.bake_with_depth(frame, camera, seed=3)[0].image


def training() -> Iterator[tuple[str, np.ndarray]]:
    """Twenty steps on a dataset of eight pictures, made by its own stages."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        scenario = str(ROOT / "configs" / "sim" / "jet.yaml")
        resolution = '"resolution={cells: 16, refinement: 2}"'
        (home / "data.yaml").write_text(_DATASET.replace("SCENARIO", scenario).replace("RESOLUTION", resolution))
        (home / "train.yaml").write_text(_TRAINING.replace("DATA", str(home / "data")))
        status = generate([str(home / "data.yaml"), "--out", str(home / "data"), "--workers", "1", "--no-estimate"])
        assert status == 0, "the golden dataset could not be made"
        assert train([str(home / "train.yaml"), "--run-dir", str(home / "run")]) == 0, "the golden training failed"
        lines = read_json_lines(home / "run" / METRICS)
    yield "training/loss", np.array([line["loss"] for line in lines if "loss" in line])


def digest(array: np.ndarray) -> list[float]:
    """Mean, root mean square, and the mean against a fixed wave, which feels where values stand."""
    values = np.nan_to_num(array.astype(np.float64), posinf=0.0).ravel()
    wave = np.sin(np.arange(values.size) * 0.37)
    return [float(values.mean()), float(np.sqrt((values**2).mean())), float((values * wave).mean())]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="keep all arrays in this file")
    parser.add_argument("--against", type=Path, help="compare with the arrays of that file; exit 1 if any differs")
    parser.add_argument("--digests", type=Path, help="write the digests of all arrays to this file")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    arrays = {**dict(flows()), **dict(pictures()), **dict(training())}
    if options.out:
        np.savez_compressed(options.out, **arrays)
    if options.digests:
        write_json(options.digests, {name: digest(array) for name, array in arrays.items()})
    return compare(arrays, options.against) if options.against else 0


def compare(arrays: dict[str, np.ndarray], path: Path) -> int:
    """Say which arrays differ from the file's; the exit status."""
    with np.load(path) as file:
        old = {name: file[name] for name in file.files}
    differing = 0
    for name in sorted(old.keys() | arrays.keys()):
        if name not in old or name not in arrays:
            print(f"{name}: only {'new' if name in arrays else 'old'}")
        elif old[name].shape != arrays[name].shape:
            print(f"{name}: shape {old[name].shape} became {arrays[name].shape}")
        elif old[name].tobytes() != arrays[name].tobytes():
            finite = np.isfinite(old[name]) & np.isfinite(arrays[name])
            largest = float(np.abs(old[name][finite].astype(np.float64) - arrays[name][finite]).max(initial=0.0))
            print(f"{name}: differs by up to {largest:.3g} (largest value {np.abs(old[name][finite]).max():.3g})")
        else:
            continue
        differing += 1
    print(f"{len(old)} arrays, {differing} differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
