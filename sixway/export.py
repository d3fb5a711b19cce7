"""Export a trained net for engines: `python -m sixway.export runs/tiny -o net.onnx --size 512`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from sixway.core.frames import parse_size
from sixway.inference.onnx import OPSET, export_onnx
from sixway.models.card import load_net


def main(arguments: Sequence[str] | None = None) -> int:
    """Write one self-contained ONNX file; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m sixway.export",
        description=f"Write one ONNX file (opset {OPSET}, static shape, float32, plain operators, weights inside), "
        "with channel names, scale and conventions in its metadata.",
    )
    parser.add_argument("run_dir", type=Path, help="folder of a trained run")
    parser.add_argument("-o", "--output", type=Path, help="file to write (default: RUN_DIR/sixway_WxH.onnx)")
    parser.add_argument("--size", default=None, help="N or WxH in px (default: the size of the training)")
    parser.add_argument("--dry-run", action="store_true", help="say what would be written, write nothing")
    options = parser.parse_args(arguments)
    try:
        net, card = load_net(options.run_dir)
        width, height = parse_size(options.size) if options.size else (card.width_px, card.height_px)
        path = options.output or options.run_dir / f"sixway_{width}x{height}.onnx"
        if options.dry_run:
            print(f"dry run: would write {path}, {width} x {height}, guide {', '.join(card.guide_channels)}")
            return 0
        difference = export_onnx(net, card, path, width_px=width, height_px=height)
    except (ValueError, OSError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"exported: {path} ({path.stat().st_size / 1e6:.2f} MB), differs from torch by at most {difference:.1e}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
