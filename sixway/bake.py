"""Bake traditional six-way maps by path tracing: `python -m sixway.bake 'smoke_*.vdb' --out maps --up z`."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import get_args

import numpy as np
import warp as wp

from sixway.core.command import status_of
from sixway.core.config import parse_config
from sixway.core.conventions import LIGHTMAP_CHANNELS, Bounces
from sixway.core.exr import read_exr, write_exr
from sixway.core.frames import Camera, parse_size
from sixway.core.png import write_8bit_png
from sixway.core.progress import track
from sixway.core.records import Medium
from sixway.core.store import claim_folder, provenance, sha256_file
from sixway.guide.motion import project_motion
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.shading.sheet import lightmap_sheet
from sixway.volumes.extinction import DEFAULT_OPTICAL_DEPTH
from sixway.volumes.fire import EmissionRule
from sixway.volumes.read import find_volumes
from sixway.volumes.sequence import VolumeSequence, open_sequence, slice_frames

SHEET = "contact_sheet.png"
_SHEET_FRAMES = 4


def main(arguments: Sequence[str] | None = None) -> int:
    """Trace every frame that is missing; the exit status."""
    options = _parser().parse_args(arguments)
    wp.config.log_level = wp.LOG_WARNING  # Warp greets on first use
    return status_of(lambda: _run(options))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sixway.bake",
        description="Path-trace the six maps, alpha and emissive of volumes from a fixed camera: one EXR a frame "
        "and a contact sheet. The same command continues where it stopped.",
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
    add("--emission", default="auto", help="grid that burns, such as temperature, or none (default: auto, by name)")
    add("--emission-threshold", type=float, help="where glow begins (default: 0; of temperatures 798 K or 1.5)")
    add("--emission-scale", type=float, help="radiance [1/m] of fire of value 1 (default: 2 through thick columns)")
    add("--self-lit", action="store_true", help="another layer: smoke in the light of its own fire")
    add("--motion", action="store_true", help="layers flow_right, flow_down [px a frame], from the wind of the volumes")
    add("--camera-yaw", type=float, default=0.0, help="degrees (default: 0)")
    add("--camera-pitch", type=float, default=0.0, help="degrees (default: 0)")
    add("--projection", choices=("perspective", "orthographic"), default="perspective")
    add("--margin", type=float, default=1.0, help="bounding radii that the image frames (default: 1)")
    add("--seed", type=int, default=0)
    add("--device", choices=("auto", "cpu", "cuda"), default="auto")
    add("--replace", action="store_true", help="delete what the folder holds of other settings")
    add("--dry-run", action="store_true", help="say what would be baked, bake nothing")
    return parser


def _run(options: argparse.Namespace) -> int:
    for name in ("optical_depth", "density_scale", "emission_scale", "margin"):
        value = getattr(options, name)
        if value is not None and not 0.0 < value < float("inf"):
            raise ValueError(f"--{name.replace('_', '-')} {value} must be positive and finite")
    width, height = parse_size(options.resolution)
    reference = {"bounces": options.bounces, "samples": options.samples}
    config = parse_config(ReferenceConfig, reference, source="command line")
    volumes = slice_frames(find_volumes(options.volume), options.frames)
    sequence = open_sequence(
        volumes, up=options.up, grid_name=options.grid, optical_depth=options.optical_depth, emission=_emission(options)
    )
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
        f"{sequence.highest_density:.3g}; density scale {extinction:.4g} 1/m; {_told(sequence.emission)}; "
        f"{width} x {height}, {options.bounces}"
    )
    if options.self_lit and sequence.emission is None:
        raise ValueError("--self-lit: these volumes hold no fire; name the grid that burns with --emission")
    frame_s = _frame_s(sequence) if options.motion else None
    if options.dry_run:
        print(f"dry run: nothing was written to {options.out}")
        return 0
    files = [options.out / f"frame_{number:04d}.exr" for number in range(len(volumes))]
    settings = {
        "volumes": {path.name: sha256_file(path) for path in volumes},
        "reference": config.identity(),
        "medium": asdict(medium),
        "camera": asdict(camera),
        "seed": options.seed,
        "up": options.up,
        "grid": options.grid,
        "emission": sequence.emission and asdict(sequence.emission),
        "self_lit": options.self_lit,
        "frame_s": frame_s,
    }
    missing = claim_folder(
        options.out,
        files,
        record="bake.json",
        settings=settings,
        patterns=("frame_[0-9]*.exr",),
        replace=options.replace,
    )
    tracer = LightmapTracer(config, medium, device=options.device)
    for file in track(missing, total=len(files), label="bake", start=len(files) - len(missing)):
        number = files.index(file)
        frame = sequence.read(number)
        lightmap = tracer.trace(frame, camera, seed=options.seed)
        image, channels = lightmap.image, lightmap.channels
        if options.self_lit:
            # imported here: it loads Dr.Jit, which must not happen before the tracer has chosen its LLVM
            from sixway.reference.self_lit import trace_self_lit

            glow = trace_self_lit(frame, camera, medium, bounces=options.bounces, seed=options.seed)
            image, channels = np.concatenate([image, glow[..., None]], axis=-1), (*channels, "self_lit")
        if frame_s is not None:
            flow = project_motion(frame, camera, medium, frame_s=frame_s, device=_warp_device(options.device))
            image, channels = np.concatenate([image, flow], axis=-1), (*channels, "flow_right", "flow_down")
        about = {
            "sixway/volume": volumes[number].name,
            "sixway/units": "M = pi L / E, linear, premultiplied; alpha = 1 - T; emissive, self_lit: radiance; "
            "flow: px until the next frame",
            "sixway/extinction_per_m": extinction,
            "sixway/bounces": options.bounces,
            "sixway/method": tracer.method,
            "sixway/device": tracer.variant,
            "sixway/commit": provenance()["commit"],
        }
        write_exr(file, image, channels, about)
    channels = LIGHTMAP_CHANNELS if sequence.emission else LIGHTMAP_CHANNELS[:-1]
    channels += ("self_lit",) if options.self_lit else ()
    _write_sheet(options.out / SHEET, files, volumes, channels)
    print(f"baked: {options.out}")
    return 0


def _frame_s(sequence: VolumeSequence) -> float:
    """Seconds from a frame to the next. Raises ValueError where volumes do not tell."""
    if len(sequence.paths) < 2:
        raise ValueError("--motion: one volume does not tell how long a frame lasts; give two or more of a sequence")
    first, second = sequence.read(0), sequence.read(1)
    seconds = second.time_s - first.time_s
    if first.velocity_m_s is None or not seconds > 0.0:
        raise ValueError(
            f"--motion: {sequence.paths[0]} holds no wind, or its time is not before that of {sequence.paths[1].name}; "
            "simulate to .npz, or let python -m sixway.pack --motion estimate do without"
        )
    return seconds


def _warp_device(device: str) -> str:
    return device if device != "auto" else "cuda" if wp.is_cuda_available() else "cpu"


def _emission(options: argparse.Namespace) -> EmissionRule | None:
    if options.emission == "none":
        return None
    return EmissionRule(
        grid_name=None if options.emission == "auto" else options.emission,
        strength_per_m=options.emission_scale,
        threshold=options.emission_threshold,
    )


def _told(emission: EmissionRule | None) -> str:
    if emission is None:
        return "no fire"
    return f"fire of {emission.strength_per_m or 1.0:.4g} 1/m"


def _write_sheet(path: Path, files: list[Path], volumes: list[Path], channels: tuple[str, ...]) -> None:
    """A few frames from the first to the last; made again whenever frames were."""
    chosen = sorted({round(i * (len(files) - 1) / max(1, _SHEET_FRAMES - 1)) for i in range(_SHEET_FRAMES)})
    frames = []
    for number in chosen:
        image = read_exr(files[number], channels)
        maps = {name: image[..., i] for i, name in enumerate(channels)}
        frames.append((f"frame {number}: {volumes[number].name}", maps))
    write_8bit_png(path, lightmap_sheet(frames))


if __name__ == "__main__":
    sys.exit(main())
