"""Speed of Autodesk's XLB on this machine, for scripts/bench_sim.py: prints MLUPS as JSON.

PYTHON_OF_A_VENV scripts/bench_xlb.py CELLS LATTICE STEPS REPETITIONS

The venv needs xlb==0.3.1 and warp-lang==1.10.1 (XLB does not import with newer Warps). A closed box of CELLS^3 with a
block in its middle, half-way walls, BGK with Smagorinsky's eddy viscosity: what bench_sim.py times of sixway.
"""

import json
import sys
import time

import numpy as np
import xlb
from xlb.compute_backend import ComputeBackend
from xlb.grid import grid_factory
from xlb.operator.boundary_condition import HalfwayBounceBackBC
from xlb.operator.stepper import IncompressibleNavierStokesStepper
from xlb.precision_policy import PrecisionPolicy


def mlups(backend: ComputeBackend, cells: int, lattice: str, steps: int, repetitions: int) -> float:
    velocities = getattr(xlb.velocity_set, lattice)(precision_policy=PrecisionPolicy.FP32FP32, compute_backend=backend)
    xlb.init(velocity_set=velocities, default_backend=backend, default_precision_policy=PrecisionPolicy.FP32FP32)
    grid = grid_factory((cells,) * 3, compute_backend=backend)
    solid = np.ones((cells,) * 3, dtype=bool)
    solid[1:-1, 1:-1, 1:-1] = False
    solid[tuple(slice(cells // 2 - cells // 16, cells // 2 + cells // 16) for _ in range(3))] = True
    walls = HalfwayBounceBackBC(indices=[axis.tolist() for axis in np.nonzero(solid)])
    stepper = IncompressibleNavierStokesStepper(
        grid=grid, boundary_conditions=[walls], collision_type="SmagorinskyLESBGK"
    )
    before, after, kind, missing = stepper.prepare_fields()
    omega = 1.0 / 0.53
    seconds = []
    for _ in range(repetitions + 1):  # the first compiles
        start = time.perf_counter()
        for step in range(steps):
            before, after = stepper(before, after, kind, missing, omega, step)
            before, after = after, before
        wait(backend, before)
        seconds.append(time.perf_counter() - start)
    return cells**3 * steps / float(np.median(seconds[1:])) / 1e6


def wait(backend: ComputeBackend, field: object) -> None:
    if backend == ComputeBackend.JAX:
        field.block_until_ready()
    else:
        import warp as wp

        wp.synchronize()


if __name__ == "__main__":
    size, lattice_name, step_count, repeat = int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    found = {
        backend.name: mlups(backend, size, lattice_name, step_count, repeat)
        for backend in (ComputeBackend.WARP, ComputeBackend.JAX)
    }
    print(json.dumps(found))
