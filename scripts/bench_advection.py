"""What carrying scalars costs: each scheme, field and grid size, and what a rotation leaves of a sharp density.

python scripts/bench_advection.py --json bench_advection.json

Velocity grids are half as fine, ten lattice steps an advection, on all CPU cores. "full": noise in every voxel, so that
nothing can be skipped; "plume": a cone of noise in a twentieth of the box. Processor time is told beside the clock's:
on a shared machine the clock says little. Sizes are timed in turn, so that their ratio is of one run.
"""

import os
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
import warp as wp
from measurement import Measurement, parser
from sim_experiments_advection import SCHEMES, rotation_table

from sixway.sim.carried.forces import Forces
from sixway.sim.carried.scalars import Scalars

STEPS = 10.0
ONE_FIELD_MS, FURTHER_FIELD_MS = 150.0, 90.0  # at 128^3, cubic, on two idle cores


def main() -> int:
    chosen = parser("Cost and quality of the advection of scalars.").parse_args()
    wp.config.log_level = wp.LOG_WARNING
    threads = os.cpu_count() or 1
    repetitions = 3 if chosen.quick else 7
    result = Measurement({"threads": threads, "load_before": os.getloadavg()[0]}, repetitions)
    time_schemes(result, 64 if chosen.quick else 128, threads, repetitions)
    time_sizes(result, (32, 64, 128) if chosen.quick else (64, 128, 256), threads, repetitions)
    time_forces(result, 32 if chosen.quick else 64, threads, repetitions)
    for row in rotation_table(voxels=64 if chosen.quick else 128, threads=threads):
        for name in ("l1_error", "mass", "energy", "gradient_energy"):
            result.add(f"rotation, {row.scheme}, {name}", getattr(row, name), "of the start")
    return result.finish(chosen.json)


def time_schemes(result: Measurement, voxels: int, threads: int, repetitions: int) -> None:
    wind, ball = waves(voxels // 2), sphere(voxels)
    for filling, values in (("full", noise(voxels)), ("plume", plume(voxels))):
        for scheme in SCHEMES:
            works = {}
            for count in (1, 2, 3):
                scalars = filled(values, count, scheme, threads)
                works[count] = carry_again(scalars, wind, None)
            works["solid"] = carry_again(filled(values, 1, scheme, threads), wind, ball)
            clock, processor = times_in_turn(works, repetitions)
            bounded = voxels == 128 and scheme == "cubic"
            label = f"{voxels}^3 {filling}, {scheme}"
            one, further = clock[1], 0.5 * (clock[3] - clock[1])
            result.add(f"{label}, one field", one, "ms", at_most=ONE_FIELD_MS if bounded else None)
            result.add(f"{label}, one field", processor[1], "ms of processor time")
            result.add(f"{label}, each further field", further, "ms", at_most=FURTHER_FIELD_MS if bounded else None)
            result.add(f"{label}, each further field", 0.5 * (processor[3] - processor[1]), "ms of processor time")
            result.add(f"{label}, one field with a sphere", processor["solid"], "ms of processor time")


def time_sizes(result: Measurement, sizes: tuple[int, ...], threads: int, repetitions: int) -> None:
    for filling, make in (("full", noise), ("plume", plume)):
        works = {size: carry_again(filled(make(size), 1, "cubic", threads), waves(size // 2), None) for size in sizes}
        clock, processor = times_in_turn(works, repetitions)
        for size in sizes:
            result.add(f"cubic, {filling}, {size}^3", clock[size], "ms")
            result.add(f"cubic, {filling}, {size}^3", 1e6 * processor[size] / size**3, "ns of processor time a voxel")
        growth = (processor[sizes[-1]] / sizes[-1] ** 3) / (processor[sizes[0]] / sizes[0] ** 3)
        name = f"cubic, {filling}, cost of a voxel at {sizes[-1]}^3 to that at {sizes[0]}^3"
        result.add(name, growth, "ratio", at_most=1.5 if filling == "full" else None)


def time_forces(result: Measurement, cells: int, threads: int, repetitions: int) -> None:
    scalars = filled(noise(2 * cells), 2, "cubic", threads)
    forces = Forces(scalars, lifts={"a": 0.01, "b": 0.02}, confinement=0.01, device="cpu", threads=threads)
    wind, force = waves(cells), wp.zeros((3, *(cells + 2,) * 3), dtype=wp.float32, device="cpu")
    clock, processor = times_in_turn({0: lambda: forces.update(wind, force)}, repetitions)
    result.add(f"forces of two fields, {cells}^3", clock[0], "ms")
    result.add(f"forces of two fields, {cells}^3", processor[0], "ms of processor time")


def carry_again(scalars: Scalars, wind: wp.array, solid: wp.array | None) -> Callable[[], None]:
    """An advection from the same start each time, for blurred noise would be cheaper."""
    start = wp.clone(scalars.stacked)

    def work() -> None:
        wp.copy(scalars.stacked, start)
        scalars.advect(wind, steps=STEPS, solid_fraction=solid)

    return work


def times_in_turn(works: dict, repetitions: int) -> tuple[dict, dict]:
    """Median milliseconds by the clock and by the processor of each work, in turn; the first round is not counted."""
    clock, processor = {key: [] for key in works}, {key: [] for key in works}
    for _ in range(repetitions + 1):
        for key, work in works.items():
            started, spent = time.perf_counter(), time.process_time()
            work()
            clock[key].append(1e3 * (time.perf_counter() - started))
            processor[key].append(1e3 * (time.process_time() - spent))
    return (
        {key: statistics.median(times[1:]) for key, times in clock.items()},
        {key: statistics.median(times[1:]) for key, times in processor.items()},
    )


def filled(values: np.ndarray, fields: int, scheme: str, threads: int) -> Scalars:
    cells = tuple(n // 2 for n in values.shape)
    scalars = Scalars(
        tuple("abc"[:fields]), shape_zyx=cells, refinement=2, scheme=scheme, device="cpu", threads=threads
    )
    for field in scalars.fields.values():
        field.assign(values)
    return scalars


def noise(voxels: int) -> np.ndarray:
    return np.random.default_rng(0).random((voxels,) * 3, dtype=np.float32)


def plume(voxels: int) -> np.ndarray:
    z, y, x = np.indices((voxels,) * 3) / voxels - 0.5
    return np.where(x**2 + z**2 < (0.125 + 0.125 * y) ** 2, noise(voxels), 0.0).astype(np.float32)


def sphere(voxels: int) -> wp.array:
    z, y, x = np.indices((voxels,) * 3) / voxels - 0.5
    return wp.array(x**2 + y**2 + z**2 < 0.15**2, dtype=wp.float32, device="cpu")


def waves(cells: int) -> wp.array:
    """Wind of up to 0.1 cells/step, waves as long as the box."""
    z, y, x = 2.0 * np.pi * np.indices((cells + 2,) * 3) / cells
    return wp.array(0.1 * np.stack([np.sin(y), np.sin(z), np.cos(x)], axis=-1), dtype=wp.vec3, device="cpu")


if __name__ == "__main__":
    sys.exit(main())
