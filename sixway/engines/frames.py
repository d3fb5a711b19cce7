"""Frames on disk: the EXR files that a bake wrote, found and listed."""

import glob
import re
from pathlib import Path

import OpenEXR

from sixway.core.conventions import DIRECTIONS
from sixway.engines.packing import CARRIED


def find_frames(text: str) -> list[Path]:
    """The .exr files of a pattern, a folder, or one file, in the order of their numbers.

    Raises FileNotFoundError where there is none.
    """
    path = Path(text)
    if path.is_dir():
        found = list(path.glob("*.exr"))
    else:
        found = [path] if path.is_file() else [Path(name) for name in glob.glob(text)]
    frames = sorted((file for file in found if file.suffix.lower() == ".exr"), key=_natural)
    if not frames:
        raise FileNotFoundError(f"{text}: no .exr frames here; bake them with python -m sixway.bake")
    return frames


def _natural(path: Path) -> list[tuple[int, str]]:
    """frame_2 before frame_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", str(path))]


def slice_of(frames: list[Path], text: str | None) -> list[Path]:
    """Frames ``A:B``, B excluded; all of them for None. Raises ValueError for an empty or malformed range."""
    if text is None:
        return frames
    match = re.fullmatch(r"(\d*):(\d*)", text)
    chosen = frames[slice(*(int(n) if n else None for n in match.groups()))] if match else []
    if not chosen:
        raise ValueError(f"range {text!r} of {len(frames)} frames must be A:B with A < B, and hold a frame")
    return chosen


def layers_of(path: Path) -> set[str]:
    """Names of all layers of a frame. Raises ValueError for what is no EXR file."""
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            return {channel.name.removesuffix(".V") for channel in file.parts[0].header["channels"]}
    except Exception as error:  # OpenEXR raises bare RuntimeError and others on junk
        raise ValueError(f"{path}: not a readable EXR file ({error}); bake it again") from error


def held_channels(path: Path) -> tuple[str, ...]:
    """The channels of a frame that packings know, in the order of `CARRIED`.

    Raises ValueError where it is no six-way frame.
    """
    names = layers_of(path)
    held = tuple(name for name in CARRIED if name in names)
    if not set(held) & set(DIRECTIONS):
        raise ValueError(f"{path}: holds {sorted(names)}, none of the six maps; give frames of python -m sixway.bake")
    return held
