"""What is wrong with six-way textures, from the pictures alone: `python -m sixway.engines.validate A.png B.png`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sixway.core.command import status_of
from sixway.core.config import load_config
from sixway.core.store import write_json
from sixway.engines.diagnosis import NO_SMOKE, Pictures, Suspicion, diagnose, named, opaque, shrunk
from sixway.engines.faults import HEALTHY, Fault
from sixway.engines.flipbook import parse_grid, split
from sixway.engines.packing import PACKINGS, Packing, PackingConfig, packing_from_config, parse_packing
from sixway.engines.texture import read_picture

_SHOWN = 6


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the verdict; 0 for a healthy set, 1 for a fault or no verdict, 2 for files that cannot be read."""
    options = _parser().parse_args(arguments)
    return status_of(lambda: _run(options))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sixway.engines.validate",
        description="Tell from the pictures alone which packing a set of six-way textures has, and which single fault: "
        "channels or files swapped, mirrored, wrong curve, straight alpha, a channel missing. Faults that leave the "
        "same pictures are named together.",
        epilog="example: python -m sixway.engines.validate smoke_RTBA.png smoke_LBFE.png --packing unity --grid 8x8",
    )
    add = parser.add_argument
    add("textures", type=Path, nargs="+", help="the files of one packing, in its order")
    add("--packing", help=f"what it should be: {', '.join(PACKINGS)}, a .yaml or a mapping; without it, all are tried")
    add("--grid", default="1x1", help="COLUMNSxROWS if the textures are flipbooks (default: 1x1)")
    add("--least", type=float, default=0.5, help="confidence below which the verdict is 'undecidable' (default: 0.5)")
    add("--json", type=Path, help="write the verdict to this file")
    return parser


def _run(options: argparse.Namespace) -> int:
    if not 0.0 <= options.least <= 1.0:
        raise ValueError(f"--least {options.least} must lie between 0 and 1")
    packings = (_packing(options.packing),) if options.packing else tuple(PACKINGS.values())
    pictures = load_pictures(options.textures, options.grid)
    stacked = load_halves(options.textures[0], options.grid) if len(options.textures) == 1 else None
    suspicions = diagnose(pictures, packings, stacked=stacked)
    verdict = named(suspicions, options.least)
    likeliest = suspicions[0]
    if likeliest.members[0] == NO_SMOKE and likeliest.confidence >= options.least:
        print("undecidable: these do not look like six-way maps of smoke in any packing")
    elif verdict is None:
        print("undecidable: nothing explains these pictures clearly better than the rest")
    elif verdict.fault == HEALTHY:
        print(f"healthy: packing {verdict.packing}, confidence {verdict.confidence:.2f}")
    else:
        print(f"fault: {verdict.fault} (packing {verdict.packing}), confidence {verdict.confidence:.2f}")
        print(f"  remedy: {remedy(verdict.fault)}")
    if verdict and len(verdict.members) > 1:
        others = [_name(member) for member in verdict.members[1:]]
        print(
            "  looks the same: "
            + "; ".join(others[:_SHOWN])
            + (f"; and {len(others) - _SHOWN} more" * (len(others) > _SHOWN))
        )
    rest = [s for s in suspicions[verdict is not None :][:_SHOWN] if s.confidence >= 0.01]
    for suspicion in rest:
        print(f"  {suspicion.confidence:4.2f}  {_name(suspicion.members[0])}")
    print("cannot be told: " + "; ".join(UNTOLD))
    if options.json:
        write_json(options.json, {"verdict": _plain(verdict), "classes": [_plain(s) for s in suspicions[:20]]})
    return 0 if verdict and verdict.fault == HEALTHY else 1


def load_pictures(paths: Sequence[Path], grid: str = "1x1") -> Pictures:
    """Textures as the diagnosis wants them: tiles of one frame each, shrunk. Raises ValueError for misfits."""
    read = [read_picture(path) for path in paths]
    if len({picture.linear for picture in read}) > 1:
        raise ValueError("some of the textures hold floats and some do not; give the files of one export")
    return Pictures(tuple(_small(picture.values, grid) for picture in read), floats=read[0].linear)


def load_halves(path: Path, grid: str = "1x1") -> Pictures | None:
    """A single file read as two textures above one another; None if its rows do not hold them."""
    picture = read_picture(path)
    rows = picture.values.shape[1]
    if rows % 2 or rows // 2 % parse_grid(grid, 1).rows:
        return None
    halves = np.split(picture.values, 2, axis=1)
    return Pictures(tuple(_small(half, grid) for half in halves), floats=picture.linear)


def _small(slices: np.ndarray, grid: str) -> np.ndarray:
    return shrunk(opaque(np.concatenate([_tiles(one, grid) for one in slices])))


def _tiles(picture: np.ndarray, text: str) -> np.ndarray:
    """The tiles [n, h, w, c] of a flipbook that hold anything. Raises ValueError for a grid that does not fit."""
    grid = parse_grid(text, 1)
    tiles = split(picture, grid, grid.tiles)
    alive = np.ptp(tiles, axis=(1, 2)).max(-1) > 0.0
    return tiles[alive] if alive.any() else tiles[:1]


def _packing(text: str) -> Packing:
    if text.endswith((".yaml", ".yml")):
        return packing_from_config(load_config(PackingConfig, Path(text)), name=Path(text).stem)
    return parse_packing(text)


def remedy(fault: Fault) -> str:
    """What to do about a fault, in one sentence."""
    match fault.kind:
        case "swapped":
            return f"exchange the channels that should hold {fault.names[0]} and {fault.names[1]}"
        case "textures swapped":
            return "exchange the two files"
        case "mirrored left-right" | "mirrored top-bottom" | "turned by 180 degrees":
            return "flip the pictures back, or exchange the names of the maps along the flipped axes"
        case "colour too dark":
            return "R, G and B lack their sRGB curve: mark the texture as linear (sRGB off), or export again"
        case "colour too bright":
            return "R, G and B carry one sRGB curve too many: export again without the view transform"
        case "alpha curved":
            return "alpha is sRGB-coded; it must be linear: export it as data"
        case "A curved":
            return "the map in A is sRGB-coded; A is read linear: store it without the curve"
        case "straight":
            return "the maps are divided by alpha: use a straight alpha blend, or multiply them by alpha"
        case "rearranged":
            return f"more than one channel is misplaced; in file order the maps are {', '.join(fault.names)}"
        case "missing":
            return f"{fault.names[0]} is missing: export it again"
        case "opaque":
            return "alpha is 1 everywhere (JPEG, or RGB without A): export RGBA"
        case "inverted":
            return "alpha holds transmittance: store 1 minus it"
    return "none needed"


UNTOLD = (
    "a mirrored picture from maps of that axis with their names exchanged",
    "the brightness scale of the maps",
    "motion vectors, occlusion, and whether a blank emissive channel ought to burn",
    "curves and straight maps, where the files hold no alpha",
)
"""What no validator can tell from pictures."""


def _name(member: tuple[str, Fault]) -> str:
    packing, fault = member
    return f"{packing}, {fault}" if fault != HEALTHY else f"{packing}, healthy"


def _plain(suspicion: Suspicion | None) -> dict[str, object] | None:
    if suspicion is None:
        return None
    members = [{"packing": packing, "fault": str(fault)} for packing, fault in suspicion.members]
    return {"confidence": round(suspicion.confidence, 4), "members": members}


if __name__ == "__main__":
    sys.exit(main())
