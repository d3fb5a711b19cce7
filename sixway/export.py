"""Export a trained net: `python -m sixway.export runs/tiny --target engine --size 128 --size 512`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np

from sixway.core.frames import parse_size
from sixway.data.dataset import SmokeDataset
from sixway.guide.config import same_guide
from sixway.inference.onnx import Guides, export_onnx, export_onnx_dynamic
from sixway.inference.onnx_rules import OPSETS, Precision, Target
from sixway.inference.padding import pad_guide
from sixway.models.card import NetCard, load_net

_PICTURES = 32
"""Guides for int8: half of them calibrate, half judge."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the files asked for; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m sixway.export",
        description="Write self-contained ONNX files with channel names, scale and conventions in their metadata. "
        f"engine: opset {OPSETS['engine']}, plain operators, one file for each size. ort: opset {OPSETS['ort']}, "
        "any size that is a multiple of the net's stride.",
    )
    parser.add_argument("run_dir", type=Path, help="folder of a trained run")
    parser.add_argument("-o", "--output", type=Path, help="file to write (default: RUN_DIR/sixway_...onnx)")
    parser.add_argument("--target", choices=get_args(Target), default="engine", help="who reads it (default: engine)")
    parser.add_argument("--precision", choices=get_args(Precision), default="fp32", help="default: fp32")
    parser.add_argument(
        "--size",
        action="append",
        help="engine: N or WxH in px, may be repeated: one file each (default: the size of the training)",
    )
    parser.add_argument("--data", type=Path, help="int8: dataset whose training pictures calibrate it")
    parser.add_argument("--dry-run", action="store_true", help="say what would be written, write nothing")
    options = parser.parse_args(arguments)
    try:
        _check(options)
        net, card = load_net(options.run_dir)
        sizes = [parse_size(text) for text in options.size or []] or [(card.width_px, card.height_px)]
        for path, size in _files(options, sizes).items():
            about = f"any multiple of {net.stride} px" if size is None else f"{size[0]} x {size[1]} px"
            about += f", {options.precision}, guide {', '.join(card.guide_channels)}"
            if options.dry_run:
                print(f"dry run: would write {path}, {about}")
                continue
            if size is None:
                guides = training_guides(options.data, card, net.stride) if options.data else []
                difference = export_onnx_dynamic(net, card, path, precision=options.precision, guides=guides)
            else:
                width, height = size
                difference = export_onnx(net, card, path, width_px=width, height_px=height, precision=options.precision)
            megabytes = path.stat().st_size / 1e6
            print(f"exported: {path} ({megabytes:.2f} MB), {about}; differs from torch by {difference}")
    except (ValueError, OSError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _check(options: argparse.Namespace) -> None:
    """Raises ValueError for options that do not go together."""
    if options.target == "ort" and options.size:
        raise ValueError(f"--size {options.size[0]}: a file for ort takes every size; leave it out")
    if options.output and len(options.size or []) > 1:
        raise ValueError(f"--output {options.output} names one file for {len(options.size)} sizes; leave it out")
    if options.precision == "int8" and options.target == "engine":
        raise ValueError("--precision int8: engines lack its operators; add --target ort, or take fp16")
    if (options.precision == "int8") != (options.data is not None):
        raise ValueError("--data DATASET goes with --precision int8, which is calibrated on its training pictures")


def _files(options: argparse.Namespace, sizes: list[tuple[int, int]]) -> dict[Path, tuple[int, int] | None]:
    """Each file to write and its width and height, None if they are free."""
    precision = "" if options.precision == "fp32" else f"_{options.precision}"
    if options.target == "ort":
        return {options.output or options.run_dir / f"sixway_ort{precision}.onnx": None}
    return {options.output or options.run_dir / f"sixway_{w}x{h}{precision}.onnx": (w, h) for w, h in sizes}


def training_guides(folder: Path, card: NetCard, stride: int) -> Guides:
    """Guides [1, g, h, w] from all over the training split, every image size in turn, padded to the stride.

    Raises ValueError if the net reads another guide than the dataset has under that name.
    """
    data = SmokeDataset(folder, guide=card.guide_name, split="train")
    if data.guide_channels != card.guide_channels or not same_guide(data.guide_identity, card.guide):
        raise ValueError(f"{folder}: its guide {card.guide_name!r} is not the one that this net was trained on")
    share = -(-_PICTURES // len(data.groups))
    guides: list[np.ndarray] = []
    for which, group in enumerate(data.groups):
        rows = np.linspace(0, len(group.samples) // 2 - 1, num=min(share, len(group.samples) // 2)).astype(int)
        for row in rows:
            guide = data.pair(which, int(row)).guide.numpy()[row % 2 : row % 2 + 1]
            guides.append(pad_guide(guide, card.guide_channels, stride))
    return guides


if __name__ == "__main__":
    sys.exit(main())
