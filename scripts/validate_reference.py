"""Is the reference right? Closed forms, white furnace, one method against another, symmetries, convergence.

python scripts/validate_reference.py --json reference.json --write docs/validation.md

`--write` puts the table between the two markers `reference:begin` and `reference:end` of that file.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser

from sixway.core.config import load_config
from sixway.core.conventions import DIRECTIONS, FLIP_HORIZONTAL, FLIP_VERTICAL, Bounces
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.core.store import atomic_path, provenance
from sixway.reference.lightmaps import LightmapTracer, Method, ReferenceConfig, trace_rgb_lightmaps
from sixway.reference.lights import ConstantEnvironment, DirectionalLight
from sixway.reference.lit import trace_lit
from sixway.reference.oracle import cube_maps
from sixway.reference.variant import use_variant
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

SCENARIO = Path(__file__).parents[1] / "configs/sim/jet.yaml"
PEAK_OPTICAL_DEPTH = 10.0
DEVICE = "auto"


def tracer(medium: Medium, *, method: Method, bounces: Bounces, samples: int) -> LightmapTracer:
    return LightmapTracer(ReferenceConfig(method=method, bounces=bounces, samples=samples), medium, device=DEVICE)


def jet(frames: int) -> tuple[DensityFrame, Medium]:
    """A simulated jet, 64^3, and the medium that gives it the peak optical depth along an axis."""
    solver = SmokeSolver(load_config(ScenarioConfig, SCENARIO, ["resolution=tiny"]), device="cpu")
    for _ in range(frames):
        solver.advance()
    frame = solver.frame()
    thickest = max(float(frame.density.sum(axis).max()) for axis in range(3)) * frame.grid.voxel_size_m
    return frame, Medium(extinction_per_m=PEAK_OPTICAL_DEPTH / thickest)


def closed_forms(result: Measurement, quick: bool) -> None:
    """Single scattering in a homogeneous cube of optical depth 4, mean error of every map and of alpha."""
    voxels, pixels, s = 64, 64, 4.0
    cube = DensityFrame(density=np.ones((voxels,) * 3, np.float32), grid=Grid.centred((voxels,) * 3))
    camera = Camera.orthographic(
        position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), width_px=pixels, height_px=pixels
    )
    expected = cube_maps(s, albedo=0.8, voxels=voxels, pixels=pixels)
    inner = slice(2, -2)
    methods: tuple[tuple[Method, int], ...] = (("cached", 1), ("path", 1024 if quick else 8192))
    for method, samples in methods:
        medium = Medium(extinction_per_m=s, albedo=0.8)
        maps = tracer(medium, method=method, bounces="single", samples=samples).trace(cube, camera, seed=1)
        for name in DIRECTIONS:
            along = maps[name][inner, inner].mean(axis=1 if name in ("top", "bottom") else 0)
            error = 100.0 * abs(float(np.mean(along / expected[name][inner])) - 1.0)
            result.add(f"cube, {method}, {name}", error, "%", at_most=0.3 if method == "cached" or not quick else 1.0)
        error = 100.0 * float(np.abs(maps["alpha"][inner, inner] / (1.0 - np.exp(-s)) - 1.0).max())
        result.add(f"cube, {method}, alpha, worst pixel", error, "%", at_most=0.3)


def everywhere(count: int) -> list[tuple[float, float, float]]:
    """Unit vectors spread evenly over the sphere (Fibonacci's spiral)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - z * z)
    return [
        (float(x), float(y), float(h)) for x, y, h in zip(radius * np.cos(turn), radius * np.sin(turn), z, strict=True)
    ]


def white_furnace(result: Measurement, frame: DensityFrame, medium: Medium, quick: bool) -> None:
    """Albedo 1, radiance 1 from everywhere, all bounces: the picture equals alpha."""
    from sixway.reference.cached import CachedTracer
    from sixway.reference.path import PathTracer

    camera = Camera.around(frame.grid, yaw_deg=20.0, margin=0.75, width_px=48, height_px=48)
    suns = everywhere(24 if quick else 96)
    sets = [suns[n : n + 6] for n in range(0, len(suns), 6)]
    tracers = {
        "cached": CachedTracer(bounces="multi", samples=2, medium=medium),
        "path": PathTracer(bounces="multi", samples=256, medium=medium),
    }
    alpha = np.zeros(0)
    for name, trace in tracers.items():
        mean = np.mean([trace.trace(frame, camera, seed=n, to_lights=six) for n, six in enumerate(sets)], axis=0)
        # sum over N suns of irradiance 4 pi / N: L = 4 * mean of M
        furnace, alpha = 4.0 * mean[..., :6].mean(-1), mean[..., 6]
        error = 100.0 * abs(float(furnace.sum() / alpha.sum()) - 1.0)
        result.add(f"white furnace, {name}, {len(suns)} suns, mean", error, "%", at_most=3.0 if quick else 1.0)
    sky = ConstantEnvironment(radiance=(1.0, 1.0, 1.0))
    lit = trace_lit(frame, camera, medium, [sky], bounces="multi", samples=64 if quick else 512, device=DEVICE)
    error = 100.0 * abs(float(lit[..., 0].sum() / alpha.sum()) - 1.0)
    result.add("white furnace, trace_lit, environment, mean", error, "%", at_most=2.0 if quick else 1.0)


def blocks(pictures: np.ndarray, size: int) -> np.ndarray:
    n, height, width, channels = pictures.shape
    return pictures.reshape(n, height // size, size, width // size, size, channels).mean(axis=(2, 4))


def path_against_stock(result: Measurement, frame: DensityFrame, medium: Medium, quick: bool) -> None:
    """Independent replicates give each side its own error bars."""
    camera = Camera.around(frame.grid, yaw_deg=20.0, margin=0.75, width_px=32, height_px=32)
    count, samples = (4, 32) if quick else (8, 128)
    cases: tuple[tuple[Bounces, float], ...] = (("single", 0.0), ("paper", 0.5), ("multi", 0.0), ("multi", -0.3))
    for bounces, g in cases[2:3] if quick else cases:
        smoke = replace(medium, hg_g=g, albedo=0.9)
        both = []
        for method, n in (("path", 4 * samples), ("stock", samples)):
            trace = tracer(smoke, method=method, bounces=bounces, samples=n)
            both.append(np.stack([trace.trace(frame, camera, seed=seed).maps for seed in range(count)]))
        for size, where in ((32, "image means"), (8, "8 x 8 blocks")):
            ours, theirs = (blocks(pictures, size) for pictures in both)
            seen = theirs.mean(0) > 0.05 * theirs.mean(0).max()
            difference = (ours.mean(0) - theirs.mean(0))[seen]
            z = difference / np.sqrt((ours.var(0, ddof=1) + theirs.var(0, ddof=1))[seen] / count)
            label = f"path - stock, {bounces}, g {g:g}, {where}"
            # of Student's t with 6 or 14 degrees of freedom, 2.4 % or 1 % lie beyond 3
            result.add(f"{label}, beyond 3 sigma", 100.0 * float(np.mean(np.abs(z) > 3.0)), "%", at_most=5.0)
            result.add(f"{label}, root mean square", float(np.sqrt(np.mean(z**2))), "sigma", at_most=2.0)


def cached_against_path(result: Measurement, frame: DensityFrame, medium: Medium, quick: bool) -> None:
    """Means over the picture of each light; the paths' own error of a mean is near 0.05 %."""
    size = 48 if quick else 128
    camera = Camera.around(frame.grid, yaw_deg=30.0, margin=0.75, width_px=size, height_px=size)
    cases: tuple[tuple[Bounces, float], ...] = (("single", 0.0), ("paper", 0.0), ("paper", 0.5), ("multi", 0.0))
    for bounces, g in cases[1:2] if quick else cases:
        smoke = replace(medium, hg_g=g)
        cached = tracer(smoke, method="cached", bounces=bounces, samples=32).trace(frame, camera, seed=1).maps
        path = tracer(smoke, method="path", bounces=bounces, samples=2048).trace(frame, camera, seed=2).maps
        bias = 100.0 * np.abs(cached.mean((0, 1)) / path.mean((0, 1)) - 1.0)
        for name, value in zip(DIRECTIONS, bias, strict=True):
            result.add(f"cached - path, {bounces}, g {g:g}, {name}", float(value), "%", at_most=1.0 if quick else 0.5)


def cached_beyond(result: Measurement, frame: DensityFrame, medium: Medium, quick: bool) -> None:
    """Anisotropic multiple scattering, thick voxels and wide lights: each has arithmetic of its own."""
    size = 32 if quick else 64
    camera = Camera.around(frame.grid, yaw_deg=30.0, margin=0.75, width_px=size, height_px=size)
    voxel = float(frame.density.max()) * frame.grid.voxel_size_m
    cases: tuple[tuple[str, Medium, Bounces, float], ...] = (
        ("multi, g 0.3", replace(medium, hg_g=0.3), "multi", 0.0),
        ("multi, g -0.3", replace(medium, hg_g=-0.3), "multi", 0.0),
        ("single, thickest voxel 1", replace(medium, extinction_per_m=1.0 / voxel), "single", 0.0),
        ("paper, lights 30 deg wide", medium, "paper", 30.0),
        ("paper, g 0.5, lights 30 deg wide", replace(medium, hg_g=0.5), "paper", 30.0),
    )
    for label, smoke, bounces, angle in cases[2:4] if quick else cases:
        means = {}
        for method, samples in (("cached", 16), ("path", 1024 if quick else 8192)):
            config = ReferenceConfig(
                method=method, bounces=bounces, samples=samples, light_angle_deg=angle, source_optical_depth=0.3
            )
            means[method] = LightmapTracer(config, smoke, device=DEVICE).trace(frame, camera, seed=3).maps.mean((0, 1))
        for name, value in zip(DIRECTIONS, 100.0 * np.abs(means["cached"] / means["path"] - 1.0), strict=True):
            at_most = 1.5 if "wide" in label else 1.0 if quick or "thickest" in label else 0.5
            result.add(f"cached - path, {label}, {name}", float(value), "%", at_most=at_most)


def shared_views(result: Measurement, frame: DensityFrame, medium: Medium) -> None:
    """Views that share light against the same views alone: optical depths are the same, random numbers differ."""
    trace = tracer(medium, method="cached", bounces="paper", samples=32)
    cameras = [
        Camera.around(frame.grid, yaw_deg=yaw, margin=0.75, width_px=48, height_px=48) for yaw in (0.0, 40.0, 90.0)
    ]
    shared = trace.trace_views(frame, cameras, seeds=range(3))
    for number, (camera, lightmap) in enumerate(zip(cameras, shared, strict=True)):
        alone = trace.trace(frame, camera, seed=number).maps.mean((0, 1))
        error = 100.0 * float(np.abs(lightmap.maps.mean((0, 1)) / alone - 1.0).max())
        result.add(f"shared views, view {number}, largest difference of a light", error, "%", at_most=0.2)


def colours(result: Measurement, frame: DensityFrame, medium: Medium) -> None:
    """RGB albedo: equal colours are equal, and the lit picture of volpath shows the maps' colours."""
    camera = Camera.around(frame.grid, yaw_deg=30.0, margin=0.75, width_px=32, height_px=32)
    smoke = replace(medium, albedo=(0.9, 0.5, 0.9))
    maps = trace_rgb_lightmaps(frame, camera, smoke, samples=16, device=DEVICE)
    result.add("RGB albedo, equal colours", float(np.abs(maps[0].image - maps[2].image).max()), "", at_most=0.0)
    sun = DirectionalLight(to_light=(1.0, 0.0, 0.0))
    lit = trace_lit(frame, camera, smoke, [sun], samples=1024, device=DEVICE).mean((0, 1))
    for name, shown, lightmap in zip(("red", "green", "blue"), lit, maps, strict=True):
        error = 100.0 * abs(float(shown / lightmap["right"].mean()) - 1.0)
        result.add(f"RGB albedo, trace_lit - maps, {name}", error, "%", at_most=1.0)


def symmetries(result: Measurement, frame: DensityFrame, medium: Medium) -> None:
    """Mirrored and turned smoke permutes the maps: root mean square over the mean, single scattering."""
    camera = Camera.around(frame.grid, kind="orthographic", margin=0.75, width_px=64, height_px=64)
    trace = tracer(medium, method="cached", bounces="single", samples=1)
    maps = trace.trace(frame, camera, seed=0)
    quarter = {"top": "right", "left": "top", "bottom": "left", "right": "bottom"}
    moves: dict[str, tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray], dict[str, str]]] = {
        "mirror left-right": (lambda d: d[:, :, ::-1], lambda i: i[:, ::-1], FLIP_HORIZONTAL),
        "mirror top-bottom": (lambda d: d[:, ::-1], lambda i: i[::-1], FLIP_VERTICAL),
        "quarter turn": (lambda d: np.rot90(d, axes=(2, 1)), lambda i: np.rot90(i), quarter),
    }
    for label, (move, move_image, source) in moves.items():
        moved = trace.trace(replace(frame, density=np.ascontiguousarray(move(frame.density))), camera, seed=0)
        for name in DIRECTIONS:
            expected = move_image(maps[source.get(name, name)])
            error = 100.0 * float(np.sqrt(np.mean((moved[name] - expected) ** 2)) / expected.mean())
            result.add(f"{label}, {name}", error, "%", at_most=1.0)


def linearity(result: Measurement, frame: DensityFrame, medium: Medium) -> None:
    camera = Camera.around(frame.grid, margin=0.75, width_px=32, height_px=32)
    one, three = (
        trace_lit(frame, camera, medium, [DirectionalLight(to_light=(1.0, 0.0, 0.0), colour=(c, c, c))], samples=16)
        for c in (1.0, 3.0)
    )
    result.add("linearity in the light", float(np.abs(three - 3.0 * one).max() / three.max()), "", at_most=1e-6)


def convergence(result: Measurement, frame: DensityFrame, medium: Medium) -> None:
    """Slope of log noise over log samples, the noise from six seeds."""
    camera = Camera.around(frame.grid, margin=0.75, width_px=48, height_px=48)
    cases: tuple[tuple[Method, tuple[int, ...], float | None], ...] = (
        ("path", (64, 256, 1024), -0.55),
        ("cached", (4, 16, 64), None),  # its directions are stratified: steeper is better
    )
    for method, counts, lowest in cases:
        noise = []
        for samples in counts:
            trace = tracer(medium, method=method, bounces="paper", samples=samples)
            pictures = np.stack([trace.trace(frame, camera, seed=seed).maps for seed in range(6)])
            noise.append(float(np.sqrt(pictures.var(0, ddof=1).mean())))
        slope = float(np.polyfit(np.log(counts), np.log(noise), 1)[0])
        result.add(f"convergence, {method}, exponent", slope, "", at_most=-0.45, at_least=lowest)


def streaming(result: Measurement, frame: DensityFrame, medium: Medium) -> None:
    """Kernels that new frames, poses and seeds compile after the first.

    Smoke that thins so far that scattered light is kept on larger voxels takes other kernels, once.
    """
    import drjit as dr

    cases: tuple[tuple[Method, Bounces], ...] = (
        ("cached", "single"),
        ("cached", "paper"),
        ("cached", "multi"),
        ("path", "multi"),
        ("stock", "paper"),
    )
    for (method, bounces), thinning in (*((case, 0.05) for case in cases), (("cached", "paper"), 0.25)):
        trace = tracer(medium, method=method, bounces=bounces, samples=4)
        hashes: list[set[str]] = []
        for number in range(3):
            changed = replace(frame, density=frame.density * np.float32(1.0 - thinning * number))
            camera = Camera.around(frame.grid, yaw_deg=40.0 * number, margin=0.75, width_px=24, height_px=24)
            with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
                dr.kernel_history_clear()
                trace.trace(changed, camera, seed=number)
                hashes.append({entry["hash"] for entry in dr.kernel_history((dr.KernelType.JIT,))})
        new = len((hashes[1] | hashes[2]) - hashes[0])
        label = f"kernels compiled while streaming, {method}, {bounces}"
        if thinning > 0.1:
            result.add(f"{label}, onto larger voxels", new, "")
        else:
            result.add(label, new, "", at_most=0)


def write_between_markers(path: Path, result: Measurement) -> None:
    """Replace what stands between the markers of `path`. Raises ValueError where they are missing."""
    begin, end = "<!-- reference:begin -->", "<!-- reference:end -->"
    text = path.read_text(encoding="utf-8")
    before, found, rest = text.partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found and found_end):
        raise ValueError(f"{path} lacks the lines {begin} and {end}, between which the table belongs; add them")
    rows = [f"| {row['name']} | {row['value']:.3g} | {row['unit']} | {row['bound']} |" for row in result.rows]
    made = provenance()
    head = f"Commit {made['commit']}, {made['hardware']}, {time.perf_counter() - result.started:.0f} s."
    table = "\n".join([head, "", "| check | value | unit | bound |", "|---|---|---|---|", *rows])
    with atomic_path(path) as partial:
        partial.write_text(f"{before}{begin}\n{table}\n{end}{after}", encoding="utf-8")


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--write", type=Path, help="put the table between the markers of this document")
    options = arguments.parse_args()
    if use_variant(DEVICE).startswith("scalar"):
        print("Mitsuba runs in scalar code only: nothing to validate here, skipped")
        return 0
    wp.config.log_level = wp.LOG_WARNING
    quick = options.quick
    config = {"scenario": SCENARIO.name, "peak_optical_depth": PEAK_OPTICAL_DEPTH, "quick": quick}
    result = Measurement(config, repetitions=1)
    frame, medium = jet(16 if quick else 32)
    closed_forms(result, quick)
    white_furnace(result, frame, medium, quick)
    path_against_stock(result, frame, medium, quick)
    cached_against_path(result, frame, medium, quick)
    cached_beyond(result, frame, medium, quick)
    shared_views(result, frame, medium)
    colours(result, frame, medium)
    symmetries(result, frame, medium)
    linearity(result, frame, medium)
    convergence(result, frame, medium)
    streaming(result, frame, medium)
    if options.write:
        write_between_markers(options.write, result)
    return result.finish(options.json)


if __name__ == "__main__":
    sys.exit(main())
