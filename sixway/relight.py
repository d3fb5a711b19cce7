"""Relight a volume: `python -m sixway.relight cloud.nvdb --light right -o out.png`."""

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import warp as wp

from sixway.core.color import encode_srgb
from sixway.core.command import status_of
from sixway.core.frames import Grid, parse_size
from sixway.core.png import to_8bit, write_png
from sixway.core.progress import track
from sixway.core.store import claim_folder, sha256_file
from sixway.core.video import write_video
from sixway.inference.bake import LightmapBaker
from sixway.inference.obstacles import Obstacles, Shadows
from sixway.inference.predict import SHIPPED_NET, load_predictor
from sixway.inference.remap_notation import parse_remap
from sixway.inference.sequence import Path1D, Shot, camera_of, render
from sixway.inference.solid_notation import SOLID_FORMS, mesh_file, parse_solid
from sixway.shading.blend import BlendRule
from sixway.shading.colour import SmokeColour
from sixway.shading.notation import LIGHT_FORMS, parse_light, parse_rgb
from sixway.shading.sky import read_environment
from sixway.volumes.extinction import DEFAULT_OPTICAL_DEPTH
from sixway.volumes.read import find_volumes
from sixway.volumes.sequence import VolumeSequence, open_sequence, slice_frames

_PATH_PICTURES = 48


def main(arguments: Sequence[str] | None = None) -> int:
    """Render what was asked for; the exit status."""
    options = _parser().parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
    wp.config.log_level = wp.LOG_WARNING  # Warp greets on first use
    return status_of(lambda: _run(options))


def _joined(arguments: Sequence[str]) -> list[str]:
    """``--light -1:0:0`` as ``--light=-1:0:0``: argparse takes a leading minus for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and re.fullmatch(r"--[a-z-]+", joined[-1]) and re.match(r"-[0-9.]", argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sixway.relight",
        description="March a guide through density volumes, predict their six-way lightmaps, and shade them.",
        epilog="example: python -m sixway.relight 'smoke_*.npz' --light right,1,0.9,0.8 "
        "--light 0:1:0.3,0.2,0.3,0.5 --camera-yaw 0:90 -o turn.mp4",
    )
    add = parser.add_argument
    add("volume", help=".vdb, .nvdb, .vol, .npz, .npy or .pbrt file, a folder, or a pattern (quoted)")
    add("--checkpoint", type=Path, default=SHIPPED_NET, help="run folder or .onnx file (default: the shipped net)")
    add("-o", "--output", type=Path, required=True, help="out.png, out.mp4, or a folder of PNGs")
    add("--light", action="append", help=f"{LIGHT_FORMS}; may be repeated (default: right)")
    add("--environment", type=Path, help="lat-long picture of the sky (.exr, .png) that lights the smoke")
    add("--smoke-colour", default="1,1,1", help="linear R,G,B of the smoke itself (default: white)")
    add("--absorption", type=float, metavar="S", help="dye by absorption of strength 0 to 1 instead of multiplying")
    add("--turn-lights", default="0", help="A or A:B: degrees around the camera's up axis")
    add("--camera-yaw", default="0", help="A or A:B in degrees; A:B makes a sequence")
    add("--camera-pitch", default="0", help="A or A:B in degrees")
    add("--frames", help="A:B of the sorted volumes, B excluded")
    add("--pictures", type=int, help=f"pictures of a path through one volume (default: {_PATH_PICTURES})")
    add("--size", help="N or WxH in px (default: 256, or the size of the .onnx file)")
    add("--up", choices=("y", "z"), default="y", help="axis of the file that points up (default: y)")
    add("--grid", default="density", help="name of the grid in a file that holds several (default: density)")
    add(
        "--optical-depth",
        type=float,
        default=DEFAULT_OPTICAL_DEPTH,
        help="of the densest frame (default: 8)",
    )
    add("--density-scale", type=float, help="extinction [1/m] of density 1, instead of --optical-depth")
    add("--blend", choices=get_args(BlendRule), default="squared", help="rule of the six maps' weights")
    add("--exposure", type=float, help="factor on the light (default: the net's brightness scale)")
    add("--background", default="0.05,0.08,0.13", help="linear R,G,B behind the smoke")
    add("--margin", type=float, default=0.8, help="what the image frames, in bounding radii (default: 0.8)")
    add("--fps", type=int, default=24, help="of a video (default: 24)")
    add("--device", default="cpu", help="cpu or cuda (default: cpu)")
    add("--replace", action="store_true", help="delete what the output folder holds of other settings")
    add("--dry-run", action="store_true", help="say what would be rendered, render nothing")
    add = parser.add_argument_group("solids, which shadow the smoke and hide what is behind them").add_argument
    add("--solid", action="append", help=f"{SOLID_FORMS}; in radii of the volume around its centre; may be repeated")
    add("--solid-colour", default="0,0,0", help="linear R,G,B, the same all over (default: black)")
    add("--shadows", choices=get_args(Shadows), default="march", help="through the smoke, or on its shell (rough)")
    add("--shadow-softness", type=float, default=0.0, metavar="S", help="blur of shadows, in radii (default: 0)")
    add("--soft-particles", type=float, metavar="S", help="fade into solids over S radii, as sprites in an engine do")
    about = "curves, on maps divided by alpha, 1 being as bright as the net's brightest, as textures hold them"
    add = parser.add_argument_group(about).add_argument
    add("--map-range", metavar="A:B", help="values that become 0 and 1; beyond them is cut off")
    add("--map-contrast", metavar="I[:PIVOT]", help="-5 to 5, around PIVOT (default: 0.5); cuts off at 1")
    add("--map-curve", metavar="V:R,V:R,...", help="value V becomes R, straight lines in between; instead of contrast")
    add("--map-to", metavar="A:B", help="what 0 and 1 become in the end")
    add("--alpha-curve", metavar="V:R,V:R,...", help="alpha V becomes R; the maps follow")
    return parser


def _run(options: argparse.Namespace) -> int:
    predictor = load_predictor(options.checkpoint, device=options.device)
    for name in ("optical_depth", "density_scale", "exposure", "margin", "fps"):
        value = getattr(options, name)
        if value is not None and not 0.0 < value < float("inf"):
            raise ValueError(f"--{name.replace('_', '-')} {value} must be positive and finite")
    volumes = slice_frames(find_volumes(options.volume), options.frames)
    sequence = open_sequence(volumes, up=options.up, grid_name=options.grid, optical_depth=options.optical_depth)
    extinction = options.density_scale or sequence.extinction_per_m
    card = predictor.card
    own_size = (card.width_px, card.height_px) if options.checkpoint.suffix == ".onnx" else (256, 256)
    width, height = parse_size(options.size) if options.size else own_size
    shot = _shot(options, sequence, width, height, exposure=options.exposure or card.scale)
    print(
        f"{len(volumes)} volume(s) in {sequence.grid.shape_zyx[::-1]} voxels, "
        f"density up to {sequence.highest_density:.3g}; "
        f"density scale {extinction:.4g} 1/m; {shot.num_pictures} picture(s) of {width} x {height}"
    )
    suffix = options.output.suffix.lower()
    if suffix not in ("", ".png", ".mp4"):
        raise ValueError(f"--output {options.output}: cannot write {suffix!r}; name a .png, a .mp4 or a folder")
    if suffix == ".png" and shot.num_pictures > 1:
        raise ValueError(
            f"--output {options.output}: {shot.num_pictures} pictures need a folder or a .mp4, not one .png"
        )
    if suffix == ".mp4" and min(width, height) < 2:
        raise ValueError(f"--size {width}x{height}: a video needs sides of at least 2 px")
    for number in (0, shot.num_pictures - 1):
        camera = camera_of(shot, number)  # a view that cannot be is told of before anything is rendered
        if shot.obstacles is not None:
            shot.obstacles.check(shot.lights, shot.sequence.grid, camera)
    if options.dry_run:
        print(f"dry run: nothing was written to {options.output}")
        return 0
    baker = LightmapBaker(predictor, extinction_per_m=extinction, device=options.device)
    numbers = list(range(shot.num_pictures))
    if suffix == "":
        meshes = [path for path in map(mesh_file, options.solid or []) if path is not None]
        inputs = [*volumes, *([options.environment] if options.environment else []), *meshes]
        settings = {
            "options": _shaping(options),
            "files": {path.name: sha256_file(path) for path in inputs},
            "extinction_per_m": extinction,
            "net": card.weights_sha256,
        }
        _write_folder(options.output, shot, baker, settings=settings, replace=options.replace)
    else:
        pictures = track(render(shot, baker, numbers), total=len(numbers), label="relight")
        if suffix == ".png":
            for _, picture in pictures:
                write_png(options.output, picture)
        else:
            frames = (to_8bit(encode_srgb(picture)) for _, picture in pictures)
            write_video(options.output, frames, width=width, height=height, fps=options.fps)
    print(f"relit: {options.output}")
    return 0


def _shaping(options: argparse.Namespace) -> dict[str, Any]:
    """The options that shape pictures and were given: one that is learnt later leaves older folders as they are."""
    elsewhere = ("volume", "checkpoint", "environment", "output", "fps", "device", "replace", "dry_run")
    default = _parser().get_default
    return {name: value for name, value in vars(options).items() if name not in elsewhere and value != default(name)}


def _write_folder(
    folder: Path, shot: Shot, baker: LightmapBaker, *, settings: Mapping[str, Any], replace: bool
) -> None:
    """Numbered PNGs; the same command again makes only those that are missing."""
    files = [folder / f"picture_{number:04d}.png" for number in range(shot.num_pictures)]
    missing = claim_folder(
        folder, files, record="relight.json", settings=settings, patterns=("picture_[0-9]*.png",), replace=replace
    )
    numbers = [files.index(file) for file in missing]
    for number, picture in track(render(shot, baker, numbers), total=len(numbers), label="relight"):
        write_png(files[number], picture)


def _shot(options: argparse.Namespace, sequence: VolumeSequence, width: int, height: int, *, exposure: float) -> Shot:
    yaw, pitch, turn = (Path1D.parse(t) for t in (options.camera_yaw, options.camera_pitch, options.turn_lights))
    moves = yaw.moves or pitch.moves or turn.moves
    count = options.pictures if options.pictures is not None else (_PATH_PICTURES if moves else 1)
    if count < 1:
        raise ValueError(f"--pictures {count} must be at least 1")
    if len(sequence.paths) > 1:
        if options.pictures is not None:
            raise ValueError(f"--pictures {count}: {len(sequence.paths)} volumes make one picture each; leave it out")
        count = len(sequence.paths)
    return Shot(
        sequence=sequence,
        num_pictures=count,
        yaw_deg=yaw,
        pitch_deg=pitch,
        light_turn_deg=turn,
        lights=tuple(parse_light(text, sequence.grid) for text in options.light or ["right"]),
        rule=options.blend,
        exposure=exposure,
        background=parse_rgb(options.background, name="--background"),
        width_px=width,
        height_px=height,
        margin=options.margin,
        colour=_smoke_colour(options),
        environment=read_environment(options.environment) if options.environment else None,
        remap=parse_remap(
            low_high=options.map_range,
            contrast=options.map_contrast,
            curve=options.map_curve,
            to=options.map_to,
            alpha=options.alpha_curve,
        ),
        obstacles=_obstacles(options, sequence.grid),
    )


def _obstacles(options: argparse.Namespace, grid: Grid) -> Obstacles | None:
    if not options.solid:
        if options.soft_particles is not None or options.shadow_softness:
            raise ValueError("--soft-particles and --shadow-softness are about solids; name one with --solid")
        return None
    softness, fade = options.shadow_softness, options.soft_particles
    if not 0.0 <= softness < float("inf"):
        raise ValueError(f"--shadow-softness {softness} must be finite and not negative")
    if fade is not None and not 0.0 < fade < float("inf"):
        raise ValueError(f"--soft-particles {fade} must be positive and finite; leave it out for what is behind alone")
    return Obstacles(
        solids=tuple(parse_solid(text, grid, up=options.up) for text in options.solid),
        shadows=options.shadows,
        softness_m=softness * grid.radius_m,
        fade_m=None if fade is None else fade * grid.radius_m,
        colour=parse_rgb(options.solid_colour, name="--solid-colour"),
    )


def _smoke_colour(options: argparse.Namespace) -> SmokeColour:
    rgb = parse_rgb(options.smoke_colour, name="--smoke-colour")
    if options.absorption is None:
        return SmokeColour(rgb=rgb)
    if not 0.0 <= options.absorption <= 1.0:
        raise ValueError(f"--absorption {options.absorption} must lie in [0, 1]")
    return SmokeColour(rgb=rgb, mode="absorption", strength=options.absorption)


if __name__ == "__main__":
    sys.exit(main())
