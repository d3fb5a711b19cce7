"""Remake the small volume of our own that tests and examples use: tests/data/jet.npz.

python scripts/make_test_data.py
"""

from pathlib import Path

from sixway.core.config import load_config
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver
from sixway.volumes.npz import write_npz

ROOT = Path(__file__).parents[1]
SETTINGS = ("resolution={cells: 16, refinement: 2}", "inlets.0.radius_m=0.12", "frames=1", "warmup_frames=100")


def main() -> None:
    scenario = load_config(ScenarioConfig, ROOT / "configs/sim/jet.yaml", SETTINGS)
    frame = next(SmokeSolver(scenario, device="cpu").frames())
    write_npz(ROOT / "tests/data/jet.npz", frame)
    print(f"tests/data/jet.npz: {frame.density.shape}, density up to {frame.density.max():.2f}")


if __name__ == "__main__":
    main()
