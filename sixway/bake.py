"""Bake traditional six-way maps by path tracing: `python -m sixway.bake 'smoke_*.vdb' --out maps --up z`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import warp as wp

from sixway.core.config import parse_config
from sixway.core.conventions import Bounces
from sixway.core.exr import write_exr
from sixway.core.frames import Camera, parse_size
from sixway.core.progress import track
from sixway.core.records import Medium
from sixway.core.store import claim_folder, content_hash, provenance
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.volumes.extinction import DEFAULT_OPTICAL_DEPTH
from sixway.volumes.read import find_volumes
from sixway.volumes.sequence import open_sequence, slice_frames


def main(arguments: Sequence[str] | None = None) -> int:
    """Trace every frame that is missing; the exit status."""
    options = _parser().parse_args(arguments)
    wp.config.log_level = wp.LOG_WARNING  # Warp greets on first use
    try:
        return _run(options)
    except (ValueError, OSError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sixway.bake",
        description="Path-trace the six maps and alpha of density volumes from a fixed camera, one EXR a frame. "
        "The same command continues where it stopped.",
        epilog="example: python -m sixway.bake 'fire_*.vdb' --out maps --resolution 512 --bounces multi --up z",
    )
    add = parser.add_argument
    add("volume", help=".vdb, .nvdb, .vol, .npz, .npy or .pbrt file, a folder, or a pattern (quoted)")
    add("--out", type=Path, required=True, help="folder for frame_0000.exr, ...")
    add("--resolution", default="256", help="N or WxH in px (default: 256)")
    add("--frames", help="A:B of the sorted volumes, B excluded")
    add("--bounces", choices=get_args(Bounces), default="paper", help="indirect bounces: 0, 1, unlimited")
    add("--samples", type=int, default=8, help="directions a voxel and bounce (default: 8)")
    add("--albedo", type=float, default=1.0, help="scattered part of what smoke takes from light (default: 1)")
    add("--hg-g", type=float, default=0.0, help="anisotropy of scattering (default: 0)")
    add("--up", choices=("y", "z"), default="y", help="axis of the file that points up (default: y)")
    add("--grid", default="density", help="name of the grid in a file that holds several (default: density)")
    add("--optical-depth", type=float, default=DEFAULT_OPTICAL_DEPTH, help="of the densest frame (default: 8)")
    add("--density-scale", type=float, help="extinction [1/m] of density 1, instead of --optical-depth")
    add("--camera-yaw", type=float, default=0.0, help="degrees (default: 0)")
    add("--camera-pitch", type=float, default=0.0, help="degrees (default: 0)")
    add("--projection", choices=("perspective", "orthographic"), default="perspective")
    add("--margin", type=float, default=1.0, help="bounding radii that the image frames (default: 1)")
    add("--seed", type=int, default=0)
    add("--device", choices=("auto", "cpu", "cuda"), default="auto")
    add("--dry-run", action="store_true", help="say what would be baked, bake nothing")
    return parser


def _run(options: argparse.Namespace) -> int:
    for name in ("optical_depth", "density_scale", "margin"):
        value = getattr(options, name)
        if value is not None and not 0.0 < value < float("inf"):
            raise ValueError(f"--{name.replace('_', '-')} {value} must be positive and finite")
    width, height = parse_size(options.resolution)
    reference = {"bounces": options.bounces, "samples": options.samples}
    config = parse_config(ReferenceConfig, reference, source="command line")
    volumes = slice_frames(find_volumes(options.volume), options.frames)
    sequence = open_sequence(volumes, up=options.up, grid_name=options.grid, optical_depth=options.optical_depth)
    extinction = options.density_scale or sequence.extinction_per_m
    medium = Medium(extinction_per_m=extinction, albedo=options.albedo, hg_g=options.hg_g)
    camera = Camera.around(
        sequence.grid,
        yaw_deg=options.camera_yaw,
        pitch_deg=options.camera_pitch,
        kind=options.projection,
        margin=options.margin,
        width_px=width,
        height_px=height,
    )
    print(
        f"{len(volumes)} volume(s) in {sequence.grid.shape_zyx[::-1]} voxels, density up to "
        f"{sequence.highest_density:.3g}; density scale {extinction:.4g} 1/m; {width} x {height}, {options.bounces}"
    )
    if options.dry_run:
        print(f"dry run: nothing was written to {options.out}")
        return 0
    stamps = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in volumes]
    files = [options.out / f"frame_{number:04d}.exr" for number in range(len(volumes))]
    made_by = content_hash([repr(x) for x in (stamps, config, medium, camera, options.seed, options.up, options.grid)])
    missing = claim_folder(options.out, files, record="bake.json", made_by=made_by, pattern="frame_[0-9]*.exr")
    tracer = LightmapTracer(config, medium, device=options.device)
    for file in track(missing, total=len(files), label="bake", start=len(files) - len(missing)):
        number = files.index(file)
        lightmap = tracer.trace(sequence.read(number), camera, seed=options.seed)
        about = {
            "sixway/volume": volumes[number].name,
            "sixway/units": "M = pi L / E, linear, premultiplied; alpha = 1 - T",
            "sixway/extinction_per_m": extinction,
            "sixway/bounces": options.bounces,
            "sixway/commit": provenance()["commit"],
        }
        write_exr(file, lightmap.image, lightmap.channels, about)
    print(f"baked: {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
