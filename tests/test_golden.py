"""Every stage still answers what it answered: digests of flows, guides, references, the net and a training curve.

`scripts/golden.py` compares two commits byte by byte on one machine. What is committed here carries tolerances, since
compilers and processors differ: 1e-3 of an array's root mean square for most, more where turbulence or a path tracer's
random walk makes a last bit grow.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOLERANCE = {"sim": 1e-2, "guide": 1e-3, "reference": 1e-2, "net": 1e-3, "training": 1e-2}


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[float]]:
    path = tmp_path_factory.mktemp("golden") / "digests.json"
    command = [sys.executable, str(ROOT / "scripts" / "golden.py"), "--digests", str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(path.read_text())


def committed() -> dict[str, list[float]]:
    return json.loads((ROOT / "tests" / "golden" / "digests.json").read_text())


def test_the_same_arrays_are_answered(answered: dict[str, list[float]]) -> None:
    assert answered.keys() == committed().keys()


@pytest.mark.parametrize("name", sorted(committed()))
def test_digest_stands(answered: dict[str, list[float]], name: str) -> None:
    wanted = committed()[name]
    bound = TOLERANCE[name.partition("/")[0]] * wanted[1]
    assert answered[name] == pytest.approx(wanted, abs=bound)
