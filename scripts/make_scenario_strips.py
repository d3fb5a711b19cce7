"""One picture of all kinds of scenario: `python scripts/make_scenario_strips.py --work runs/strips`.

Runs each scenario as `python -m sixway.simulate` does and puts their strips one below the other in
docs/images/scenarios.png. About ten minutes on two CPU cores; run again, it goes on where it stopped.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from sixway import simulate
from sixway.core.png import write_8bit_png

ROOT = Path(__file__).parents[1]
NAMES = (
    *("jet", "jet_cylinder", "jet_sphere", "jet_bunny", "jet_moving_sphere", "paper_09", "two_jets", "plume"),
    *("chimney_wind", "flame", "fireball", "explosion"),
)
ROW_PX, WIDTH_PX, COLUMNS = 96, 584, 2


def main() -> int:
    options = argparse.ArgumentParser(description="Run every kind of scenario and put their strips into one picture.")
    options.add_argument("--work", type=Path, required=True, help="folder for the runs")
    options.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change all scenarios")
    chosen = options.parse_args()
    settings = [part for text in chosen.set for part in ("--set", text)]
    rows = []
    for name in NAMES:
        out = chosen.work / name
        if not (out / "strip.png").is_file():
            status = simulate.main([str(ROOT / f"configs/sim/{name}.yaml"), "--out", str(out), *settings])
            if status:
                return status
        rows.append(fitted(out / "strip.png"))
    height = -(-len(rows) // COLUMNS)
    columns = [np.concatenate(rows[start : start + height]) for start in range(0, len(rows), height)]
    write_8bit_png(ROOT / "docs/images/scenarios.png", np.concatenate(columns, axis=1))
    return 0


def fitted(path: Path) -> np.ndarray:
    """A strip at the row's height on the colour of its lower left corner; of wide ones what there is room for."""
    with Image.open(path) as strip:
        frame_px = strip.width // 6
        keep = max(1, min(6, int(WIDTH_PX / (ROW_PX / strip.height) / frame_px)))
        part = strip.crop((strip.width - keep * frame_px, 0, strip.width, strip.height))
        small = part.resize((round(part.width * ROW_PX / part.height), ROW_PX), Image.Resampling.LANCZOS)
    pixels = np.asarray(small.convert("RGB"))[:, :WIDTH_PX]
    row = np.tile(pixels[-1, 0], (ROW_PX, WIDTH_PX, 1))
    row[:, : pixels.shape[1]] = pixels
    return row


if __name__ == "__main__":
    sys.exit(main())
