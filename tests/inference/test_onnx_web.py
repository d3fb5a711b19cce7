"""Exported files run by a consumer that is not ours: onnxruntime-web (wasm) under Node.

Install it anywhere with `npm install onnxruntime-web --prefix FOLDER` and set SIXWAY_NODE_MODULES=FOLDER/node_modules;
a global install is found by itself. Nothing is fetched here.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sixway.inference.predict import OnnxPredictor

PACKAGE = "onnxruntime-web"
RUNNER = Path(__file__).parents[1] / "web/run_onnx.mjs"


@pytest.fixture(scope="module")
def node_modules() -> Path:
    if not shutil.which("node"):
        pytest.skip("no Node on this machine")
    named = os.environ.get("SIXWAY_NODE_MODULES")
    if named is None and shutil.which("npm"):
        named = subprocess.run(["npm", "root", "-g"], capture_output=True, text=True, timeout=60).stdout.strip()
    if not named or not (Path(named) / PACKAGE / "package.json").is_file():
        pytest.skip(f"no {PACKAGE} in {named or 'SIXWAY_NODE_MODULES'}: npm install {PACKAGE} --prefix FOLDER")
    return Path(named).resolve()


def test_a_browser_runtime_answers_as_python_does(
    node_modules: Path, exported: Path, dynamic_files: dict[str, Path], real_guide: np.ndarray, tmp_path: Path
) -> None:
    """Float32 to 1e-4; half and 8 bits, whose kernels round elsewhere, to a step of 8-bit pictures."""
    strange = np.random.default_rng(3).random((1, real_guide.shape[1], 36, 64), dtype=np.float32)
    cases = [
        (exported, real_guide[:1], 1e-4),
        (dynamic_files["fp32"], real_guide, 1e-4),  # two at once
        (dynamic_files["fp32"], strange, 1e-4),  # another size
        (dynamic_files["fp16"], real_guide, 1 / 255),
        (dynamic_files["int8"], real_guide, 4 / 255),
    ]
    jobs = []
    for number, (model, guide, _) in enumerate(cases):
        (tmp_path / f"guide_{number}").write_bytes(np.ascontiguousarray(guide, np.float32).tobytes())
        files = {"guide": str(tmp_path / f"guide_{number}"), "answer": str(tmp_path / f"answer_{number}")}
        jobs.append({"model": str(model), "shape": guide.shape, **files})
    (tmp_path / "jobs.json").write_text(json.dumps(jobs))
    command = ["node", str(RUNNER), str(node_modules), str(tmp_path / "jobs.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    for number, (model, guide, apart) in enumerate(cases):
        assert told["shapes"][number] == [len(guide), 8, *guide.shape[2:]]
        answer = np.fromfile(tmp_path / f"answer_{number}", np.float32).reshape(told["shapes"][number])
        expected = OnnxPredictor(model, device="cpu").encoded(guide)
        assert expected.std() > 0.01
        np.testing.assert_allclose(answer, expected, rtol=0.0, atol=apart, err_msg=model.name)
