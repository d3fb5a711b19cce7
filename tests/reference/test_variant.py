"""Mitsuba starts with a usable LLVM, or says in one line why it runs in scalar code."""

import os
import subprocess
import sys

import pytest

_TRACE = """
import numpy as np
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
grid = Grid.centred((8, 8, 8))
frame = DensityFrame(density=np.ones((8, 8, 8), np.float32), grid=grid)
tracer = LightmapTracer(ReferenceConfig(samples=8), Medium(extinction_per_m=4.0))
for kind in ("perspective", "orthographic"):
    camera = Camera.around(grid, kind=kind, width_px=12, height_px=8)
    lightmap = tracer.trace(frame, camera, seed=1)
    assert lightmap["front"][3:5, 5:7].min() > 0.05, lightmap["front"]
    assert abs(lightmap["alpha"][4, 6] - 0.98) < 0.02, lightmap["alpha"]
import mitsuba
print(tracer.method, mitsuba.variant())
"""


def run(code: str, **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True, timeout=120
    )


def test_without_llvm_it_traces_in_scalar_code_and_says_so() -> None:
    done = run(_TRACE, DRJIT_LIBLLVM_PATH="/nowhere/libLLVM.so")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["stock", "scalar_rgb"]
    fallback, method = done.stderr.splitlines()
    assert "/nowhere/libLLVM.so" in fallback and "pip install karellen-llvm-core" in fallback
    assert "cached" in method and "stock" in method


def test_importing_loads_no_llvm_and_sets_no_variant() -> None:
    done = run(
        "import sys, sixway.reference.lightmaps, sixway.reference.variant as v\n"
        "assert not {'mitsuba', 'drjit'} & set(sys.modules)\n"
        "assert 'LLVM' not in open('/proc/self/maps').read()\n"
        "assert v.describe()['variant'] == 'not set yet'"
    )
    assert done.returncode == 0, done.stderr


def test_a_child_process_finds_the_llvm_that_its_parent_named(device: str) -> None:
    from sixway.reference.variant import use_variant

    variant = use_variant("cpu")
    if variant != "llvm_ad_mono":
        pytest.skip("no LLVM here")
    done = run("from sixway.reference.variant import *; print(use_variant('cpu')); print(use_variant('cpu'))")
    assert done.stdout.split() == ["llvm_ad_mono"] * 2 and not done.stderr


def test_drjit_imported_too_early_is_told_not_crashed() -> None:
    """Whatever library Dr.Jit then found by itself, the answer is a variant that works."""
    environment = {key: value for key, value in os.environ.items() if key != "DRJIT_LIBLLVM_PATH"}
    code = "import drjit; from sixway.reference.variant import use_variant as u; print(u('cpu'))"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() in ("llvm_ad_mono", "scalar_rgb"), done.stderr


def test_cuda_where_there_is_none_is_an_error(device: str) -> None:
    from sixway.reference.variant import use_variant

    if device == "cuda":
        assert use_variant("cuda") == "cuda_ad_mono"
    else:
        use_variant("cpu")
        import drjit as dr

        if not dr.has_backend(dr.JitBackend.CUDA):
            with pytest.raises(ValueError, match="NVIDIA driver"):
                use_variant("cuda")
