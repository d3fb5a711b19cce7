"""Engine textures back to frames: `python -m sixway.unpack smoke.json --out frames`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from sixway.core.command import status_of
from sixway.core.exr import write_exr
from sixway.core.progress import track
from sixway.engines.book import read_book


def main(arguments: Sequence[str] | None = None) -> int:
    """Write one layered EXR a frame; the exit status."""
    options = _parser().parse_args(arguments)
    return status_of(lambda: _run(options))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sixway.unpack",
        description="Read the textures that python -m sixway.pack wrote, by their sidecar, and write "
        "frame_0000.exr, ... with the maps by name: linear, premultiplied, brightness undone. Maps that the packing "
        "lacks stay out.",
        epilog="example: python -m sixway.unpack smoke.json --out frames",
    )
    add = parser.add_argument
    add("sidecar", type=Path, help="the .json beside the textures")
    add("--out", type=Path, required=True, help="folder for frame_0000.exr, ...")
    add("--accept-edited", action="store_true", help="read textures that were changed after they were packed")
    add("--dry-run", action="store_true", help="read and check everything, write nothing")
    return parser


def _run(options: argparse.Namespace) -> int:
    book = read_book(options.sidecar, accept_edited=options.accept_edited)
    height, width = book.frames.shape[1:3]
    print(
        f"{len(book.frames)} frame(s) of {width} x {height}, packing {book.sidecar.packing}, "
        f"channels {', '.join(book.channels)}"
    )
    if options.dry_run:
        print(f"dry run: nothing was written to {options.out}")
        return 0
    about: dict[str, str | int | float] = {
        "sixway/units": book.sidecar.units,
        "sixway/packing": book.sidecar.packing,
        "sixway/fps": book.sidecar.fps,
    }
    for number, frame in track(list(enumerate(book.frames)), total=len(book.frames), label="unpack"):
        write_exr(options.out / f"frame_{number:04d}.exr", frame, book.channels, about)
    print(f"unpacked: {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
