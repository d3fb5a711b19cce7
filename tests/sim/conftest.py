"""The experiments of `scripts/validate_sim.py` are tests here, at small sizes."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
