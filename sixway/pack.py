"""Pack a bake into engine textures: `python -m sixway.pack 'maps/frame_*.exr' --packing unity --out smoke`."""

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import get_args

import numpy as np
from jaxtyping import Float

from sixway.core.color import encode_srgb
from sixway.core.command import status_of
from sixway.core.config import load_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.exr import read_exr
from sixway.core.progress import track
from sixway.engines.book import BookStyle, book_files, sidecar_path, write_book
from sixway.engines.flipbook import Plan, decimate, every_frame, loop, parse_grid, retime
from sixway.engines.frames import find_frames, held_channels, layers_of, slice_of
from sixway.engines.motion import FLOW_CHANNELS, MOTION_CHANNELS, MotionVectors, Upwards, motion_vectors, with_motion
from sixway.engines.packing import PACKINGS, AlphaMode, Packing, PackingConfig, packing_from_config, parse_packing
from sixway.engines.texture import TEXTURE_FORMATS


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the textures and their sidecar; the exit status."""
    options = _parser().parse_args(arguments)
    return status_of(lambda: _run(options))


def _parser() -> argparse.ArgumentParser:
    packings = "\n".join(
        f"  {p.name:17s} " + ", ".join(f"{t.suffix}({' '.join(t.channels)})" for t in p.textures)
        for p in PACKINGS.values()
    )
    parser = argparse.ArgumentParser(
        prog="python -m sixway.pack",
        description="Put baked six-way frames into the textures of a game engine: named channel order, flipbook or\n"
        "array, and a JSON sidecar that says what every channel holds.\n"
        "8- and 16-bit files: R, G, B are sRGB-coded (linear where the packing says so), A is ALWAYS linear.\n"
        "EXR and RGBA16F: all linear. Alpha is 1 - transmittance.",
        epilog=f"packings (files with R G B A):\n{packings}\n\n"
        "example: python -m sixway.pack 'maps/frame_*.exr' --packing unity --out smoke --grid 8x8 --format png",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("source", help="frames of python -m sixway.bake: a pattern (quoted), a folder or one .exr")
    add("--out", type=Path, required=True, help="prefix of the files: smoke gives smoke_RTBA.png, ..., smoke.json")
    add("--packing", default="unity", help="a name from below, a .yaml file, or 'RTBA=right,top,back,alpha ...'")
    add("--grid", default="auto", help="COLUMNSxROWS of the flipbook (default: auto)")
    add("--layout", choices=("grid", "array"), default="grid", help="flipbook, or slices of an array")
    add("--format", choices=TEXTURE_FORMATS, default="png")
    add("--frames", metavar="A:B", help="frames A to B of those found, B excluded")
    add("--every", type=int, default=1, help="keep every Nth frame (default: 1)")
    add("--loop", type=int, metavar="K", help="cross-fade the last K frames into the first")
    add("--retime", type=int, metavar="N", help="N frames over the same time, neighbours blended")
    add(
        "--fps",
        type=float,
        default=24.0,
        help="frames a second of the bake (default: 24); the sidecar keeps its length",
    )
    add(
        "--motion",
        choices=("layers", "estimate"),
        help="add motion vectors, texture MV unless the packing has them: from the layers flow_right and flow_down of "
        "the frames (python -m sixway.bake --motion), or estimated from the pictures",
    )
    add("--motion-y", choices=get_args(Upwards), default="up", help="+y of the vectors: up for Unity, else down")
    add("--fix-borders", type=int, default=0, metavar="PX", help="fade tiles to 0 over their outer PX pixels")
    add("--alpha", choices=get_args(AlphaMode), default="premultiplied", help="straight divides the maps by alpha")
    add("--brightness", default="1", help="factor of the stored maps, or auto: brightest value 1 (default: 1)")
    add("--emissive-brightness", default="1", help="factor of the stored emissive, or auto (default: 1)")
    add("--dry-run", action="store_true", help="say what would be written, write nothing")
    return parser


def _run(options: argparse.Namespace) -> int:
    packing = _packing(options.packing)
    if options.motion:
        packing = with_motion(packing)
    files = slice_of(find_frames(options.source), options.frames)
    channels = held_channels(files[0])
    shape = read_exr(files[0], channels).shape[:2]
    read = lru_cache(maxsize=8)(partial(_read, files, channels, shape))
    plan, fps = _plan(options, len(files))
    grid = parse_grid(options.grid, len(plan)) if options.layout == "grid" else None
    if not 0.0 < options.fps < 1000.0:
        raise ValueError(f"--fps {options.fps} must lie between 0 and 1000")
    style = BookStyle(
        packing=packing,
        kind=options.format,
        grid=grid,
        fps=fps,
        loop=options.loop is not None,
        alpha=options.alpha,
        border_px=options.fix_borders,
        brightness=_brightness(options.brightness, "--brightness", DIRECTIONS, files, channels, options.alpha),
        emissive_brightness=_brightness(
            options.emissive_brightness, "--emissive-brightness", ("emissive",), files, channels, "premultiplied"
        ),
    )
    place = f"{grid.columns}x{grid.rows} tiles" if grid else "array slices"
    given = (*channels, *MOTION_CHANNELS) if options.motion else channels
    absent = [name for name in packing.carried if name not in given]
    print(
        f"{len(files)} frame(s) of {shape[1]} x {shape[0]}, {len(plan)} shown at {fps:.4g} fps in {place}; packing "
        f"{packing.name}, {style.alpha} alpha" + (f"; neutral, since the frames lack them: {absent}" if absent else "")
    )
    if options.dry_run:
        for file, _, _ in book_files(options.out, style, len(plan)):
            print(f"would write {file}")
        print(f"would write {sidecar_path(options.out)}\ndry run: nothing was written")
        return 0
    motion = _motion(options, files, channels, shape, plan, span=options.fps / fps) if options.motion else None
    written = write_book(
        options.out,
        style,
        plan=plan,
        channels=channels,
        shape_px=shape,
        read=read,
        motion=motion,
        progress=lambda numbers: track(numbers, total=len(plan), label="pack"),
    )
    if motion:
        print(f"motion: scale {motion.scale:.4g} of a tile a frame, +y is {motion.y}; both are in the sidecar")
    if written.clipped > 0.0:
        print(f"warning: {100 * written.clipped:.2g} % of the map values were clipped at 1; try --brightness auto")
    print("packed: " + ", ".join(str(file) for file in written.files[:4]) + (" ..." if len(written.files) > 4 else ""))
    return 0


def _packing(text: str) -> Packing:
    if text.endswith((".yaml", ".yml")):
        return packing_from_config(load_config(PackingConfig, Path(text)), name=Path(text).stem)
    return parse_packing(text)


def _read(files: list[Path], channels: tuple[str, ...], shape: tuple[int, int], number: int) -> np.ndarray:
    return read_exr(files[number], channels, shape)


def _plan(options: argparse.Namespace, frames: int) -> tuple[Plan, float]:
    """What the book shows, and its frames a second: playing takes as long as before."""
    plan = decimate(every_frame(frames), options.every)
    fps = options.fps / options.every
    if options.loop is not None:
        plan = loop(plan, options.loop)
    if options.retime is not None:
        fps *= options.retime / len(plan)
        plan = retime(plan, options.retime, closed=options.loop is not None)
    return plan, fps


def _motion(
    options: argparse.Namespace,
    files: list[Path],
    channels: tuple[str, ...],
    shape: tuple[int, int],
    plan: Plan,
    *,
    span: float,
) -> MotionVectors:
    if options.motion == "layers":
        lacking = [file for file in files if not set(FLOW_CHANNELS) <= layers_of(file)]
        if lacking:
            raise ValueError(
                f"{lacking[0]}: has no layers {' and '.join(FLOW_CHANNELS)}; bake with --motion, or use estimate"
            )
        flows = np.stack([read_exr(file, FLOW_CHANNELS, shape) for file in files])
    else:
        flows = estimated_flows(len(files), lambda number: _read(files, channels, shape, number), channels)
    alphas = np.stack([read_exr(file, ("alpha",), shape)[..., 0] for file in files])
    return motion_vectors(plan, flows, alphas, span=span, y=options.motion_y)


def estimated_flows(
    frames: int, read: Callable[[int], Float[np.ndarray, "h w c"]], channels: tuple[str, ...]
) -> Float[np.ndarray, "n h w 2"]:
    """Flow of each frame until the next by Lucas-Kanade on maps and alpha [px; right, down]; the last repeats."""
    # imported here: torch takes seconds to load, and nothing else in this command needs it
    import torch

    from sixway.models.flow_lucas_kanade import LucasKanade

    estimator = LucasKanade()
    index = [channels.index(name) for name in (*DIRECTIONS, "alpha") if name in channels]

    def picture(number: int) -> torch.Tensor:
        image = encode_srgb(read(number)[..., index])
        return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)[None]))

    flows = []
    with torch.no_grad():
        for number in track(range(frames - 1), total=frames - 1, label="motion"):
            flows.append(estimator(picture(number), picture(number + 1))[0].permute(1, 2, 0).numpy())
    return np.stack([*flows, flows[-1]] if flows else [np.zeros((*read(0).shape[:2], 2), np.float32)])


def _brightness(
    text: str, option: str, names: Sequence[str], files: list[Path], channels: tuple[str, ...], alpha: AlphaMode
) -> float:
    """The factor of stored values; auto brings the brightest value of all frames to 1."""
    if text != "auto":
        try:
            factor = float(text)
        except ValueError:
            factor = 0.0
        if not 0.0 < factor < 1e6:
            raise ValueError(f"{option} {text!r} must be a positive number or auto")
        return factor
    brightest = 0.0
    index = [channels.index(name) for name in names if name in channels]
    for file in files:
        image = read_exr(file, channels)
        values = image[..., index]
        if alpha == "straight":
            values = values / np.maximum(image[..., channels.index("alpha")], 1.0 / 255.0)[..., None]
        brightest = max(brightest, float(values.max(initial=0.0)))
    return 1.0 / brightest if brightest > 0.0 else 1.0


if __name__ == "__main__":
    sys.exit(main())
