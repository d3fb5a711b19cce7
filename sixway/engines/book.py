"""A whole flipbook: frames of a bake to texture files with a sidecar, and back."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS
from sixway.core.store import inside, sha256_file
from sixway.engines.alpha import to_premultiplied, to_straight
from sixway.engines.flipbook import Plan, TileGrid, border_ramp, place, shown_frame, split
from sixway.engines.motion import FLOW_CHANNELS, MOTION_CHANNELS, MotionVectors, decoded
from sixway.engines.packing import AlphaMode, Packing, pack, unpack
from sixway.engines.sidecar import (
    FileEntry,
    GridEntry,
    MotionEntry,
    Sidecar,
    read_sidecar,
    texture_entry,
    write_sidecar,
)
from sixway.engines.texture import LARGEST_PIXELS, TextureFormat, is_float, read_texture, suffix_of, write_texture

Layout = Literal["grid", "array"]
_LIGHT = (*DIRECTIONS, "alpha", "emissive")


@dataclass(frozen=True, kw_only=True)
class BookStyle:
    """How a book is written. grid: None makes an array of slices. border_px: fade to 0 at the rim of each tile.

    brightness, emissive_brightness: what stored maps and emissive are multiplied by.
    """

    packing: Packing
    kind: TextureFormat
    grid: TileGrid | None
    fps: float = 24.0
    loop: bool = False
    alpha: AlphaMode = "premultiplied"
    brightness: float = 1.0
    emissive_brightness: float = 1.0
    border_px: int = 0


def book_files(prefix: Path, style: BookStyle, frames: int) -> list[tuple[Path, list[int], int | None]]:
    """(file, numbers of its textures, slice or None) for every texture file of a book, without writing any."""
    numbers = list(range(len(style.packing.textures)))
    groups = [numbers] if style.packing.stacked else [[i] for i in numbers]
    end = suffix_of(style.kind)
    files: list[tuple[Path, list[int], int | None]] = []
    for group in groups:
        stem = f"{prefix.name}_{'_'.join(style.packing.textures[i].suffix for i in group)}"
        if style.grid is None and not style.kind.startswith("dds"):
            files += [(prefix.with_name(f"{stem}_{i:04d}{end}"), group, i) for i in range(frames)]
        else:
            files.append((prefix.with_name(stem + end), group, None))
    return files


def sidecar_path(prefix: Path) -> Path:
    """Where the sidecar of a book lies."""
    return prefix.with_name(f"{prefix.name}.json")


@dataclass(frozen=True, kw_only=True)
class WrittenBook:
    """files: the textures, then the sidecar. clipped: part of the stored map values above 1, which a file of whole
    numbers cannot hold (0 for floats)."""

    files: tuple[Path, ...]
    clipped: float


def write_book(
    prefix: Path,
    style: BookStyle,
    *,
    plan: Plan,
    channels: tuple[str, ...],
    shape_px: tuple[int, int],
    read: Callable[[int], Float[np.ndarray, "h w c"]],
    motion: MotionVectors | None = None,
    progress: Callable[[Iterable[int]], Iterable[int]] = lambda numbers: numbers,
) -> WrittenBook:
    """Put the frames of `plan` together and write every file of the book; the sidecar comes last.

    channels, shape_px (height, width): of what `read` returns, premultiplied and linear. motion: of the frames of
    `plan`. Raises ValueError for frames that do not fit the grid, the packing or the format, and OSError when the disk
    is full.
    """
    height, width = shape_px
    if motion and motion.coded.shape != (len(plan), height, width, 2):
        raise ValueError(f"motion vectors {motion.coded.shape} do not fit {len(plan)} frames of {width} x {height} px")
    grid = style.grid
    if grid and len(plan) > grid.tiles:
        raise ValueError(
            f"{len(plan)} frames do not fit a grid of {grid.columns}x{grid.rows} tiles; "
            "take --grid auto, or fewer frames with --retime or --every"
        )
    tall, wide = (grid.rows * height, grid.columns * width) if grid else (height * len(plan), width)
    if tall * wide > LARGEST_PIXELS:
        raise ValueError(
            f"a book of {wide} x {tall} px is over the limit of {LARGEST_PIXELS} pixels; take fewer frames"
        )
    ramp = border_ramp(height, width, style.border_px)
    shape = (1, tall, wide) if grid else (len(plan), height, width)
    books = [np.zeros((*shape, len(texture.channels)), np.float32) for texture in style.packing.textures]
    above, values = 0, 0
    for number in progress(range(len(plan))):
        image = _styled(shown_frame(plan, number, read), channels, style, ramp)
        maps = image[..., [channels.index(name) for name in DIRECTIONS if name in channels]]
        above, values = above + int(np.count_nonzero(maps > 1.0)), values + maps.size
        held = channels
        if motion:
            image = np.concatenate([image, motion.coded[number].astype(np.float32)], axis=-1)
            held = (*channels, *MOTION_CHANNELS)
        for book, picture in zip(books, pack(image, held, style.packing), strict=True):
            if grid:
                place(book[0], picture, number, grid)
            else:
                book[number] = picture
    entries, paths = [], []
    for path, group, part in book_files(prefix, style, len(plan)):
        slices = np.concatenate([books[i] for i in group], axis=1)
        write_texture(
            path, slices if part is None else slices[part : part + 1], style.packing.textures[group[0]], style.kind
        )
        entries.append(FileEntry(name=path.name, sha256=sha256_file(path), textures=group, slice=part))
        paths.append(path)
    sidecar = Sidecar(
        packing=style.packing.name,
        layout="grid" if grid else "array",
        grid=GridEntry(columns=grid.columns, rows=grid.rows) if grid else None,
        tile_px=(width, height),
        frames=len(plan),
        fps=style.fps,
        loop=style.loop,
        alpha=style.alpha,
        brightness=style.brightness,
        emissive_brightness=style.emissive_brightness,
        border_px=style.border_px,
        motion=MotionEntry(scale=motion.scale, y=motion.y) if motion else None,
        textures=[texture_entry(texture) for texture in style.packing.textures],
        files=entries,
    )
    write_sidecar(sidecar_path(prefix), sidecar)
    clipped = 0.0 if is_float(style.kind) else above / max(values, 1)
    return WrittenBook(files=(*paths, sidecar_path(prefix)), clipped=clipped)


def _styled(image: np.ndarray, channels: tuple[str, ...], style: BookStyle, ramp: np.ndarray) -> np.ndarray:
    """Border, alpha mode and brightness, in that order: a faded rim keeps its straight colours."""
    image = image.astype(np.float32, copy=True)
    light = [i for i, name in enumerate(channels) if name in _LIGHT]
    if style.border_px:
        image[..., light] *= ramp[..., None]
    if style.alpha == "straight":
        image = to_straight(image, channels)
    return _scaled(image, channels, maps=style.brightness, emissive=style.emissive_brightness)


def _scaled(image: np.ndarray, channels: tuple[str, ...], *, maps: float, emissive: float) -> np.ndarray:
    factors = {**dict.fromkeys(DIRECTIONS, maps), "emissive": emissive}
    return image * np.array([factors.get(name, 1.0) for name in channels], np.float32)


@dataclass(frozen=True, kw_only=True)
class Book:
    """Frames read back. frames: [n, h, w, c] float32, linear and premultiplied, channels by name.

    Motion vectors come as `FLOW_CHANNELS`, px a shown frame.
    """

    frames: Float[np.ndarray, "n h w c"]
    channels: tuple[str, ...]
    sidecar: Sidecar


def read_book(path: Path, *, accept_edited: bool = False) -> Book:
    """Read the book that a sidecar describes; the inverse of :func:`write_book` up to its format's precision.

    Raises FileNotFoundError, and ValueError for a sidecar or textures that cannot be trusted. accept_edited:
    read files whose hash has changed since they were packed.
    """
    sidecar = read_sidecar(path)
    packing = sidecar.packing_of()
    width, height = sidecar.tile_px
    books: dict[int, dict[int, np.ndarray]] = {}
    for entry in sidecar.files:
        file = inside(path.parent, entry.name)
        if not file.is_file():
            raise FileNotFoundError(f"{file}: {path.name} names this texture, it is missing; put it beside the sidecar")
        if not accept_edited and sha256_file(file) != entry.sha256:
            raise ValueError(f"{file}: differs from what was packed; --accept-edited reads it all the same")
        slices = read_texture(file, packing.textures[entry.textures[0]])
        if slices.shape[1] % len(entry.textures):
            raise ValueError(
                f"{file}: {slices.shape[1]} rows do not hold {len(entry.textures)} textures of whole pixels"
            )
        for number, part in zip(entry.textures, np.split(slices, len(entry.textures), axis=1), strict=True):
            books.setdefault(number, {})[entry.slice or 0] = part
    if missing := [texture.suffix for i, texture in enumerate(packing.textures) if i not in books]:
        raise ValueError(f"{path}: no file holds the textures {missing}; correct the sidecar")
    pictures = [_tiles(books[i], sidecar, path) for i in range(len(packing.textures))]
    if any(picture.shape[:3] != (sidecar.frames, height, width) for picture in pictures):
        shapes = [picture.shape[:3] for picture in pictures]
        raise ValueError(
            f"{path}: textures hold {shapes} (frames, h, w), the sidecar says {sidecar.frames} of {width}x{height}"
        )
    frames, channels = unpack(pictures, packing)
    frames = _scaled(frames, channels, maps=1.0 / sidecar.brightness, emissive=1.0 / sidecar.emissive_brightness)
    if sidecar.alpha == "straight":
        frames = np.stack([to_premultiplied(frame, channels) for frame in frames])
    if sidecar.motion:
        index = [channels.index(name) for name in MOTION_CHANNELS]
        frames[..., index] = decoded(frames[..., index], scale=sidecar.motion.scale, y=sidecar.motion.y)
        flow = dict(zip(MOTION_CHANNELS, FLOW_CHANNELS, strict=True))
        channels = tuple(flow.get(name, name) for name in channels)
    return Book(frames=frames, channels=channels, sidecar=sidecar)


def _tiles(parts: dict[int, np.ndarray], sidecar: Sidecar, path: Path) -> Float[np.ndarray, "n h w k"]:
    if sidecar.tile_grid:
        return split(parts[0][0], sidecar.tile_grid, sidecar.frames)
    if len(parts) == 1:
        return parts[0]
    if sorted(parts) != list(range(sidecar.frames)):
        raise ValueError(f"{path}: the slices of an array must be 0 to {sidecar.frames - 1}, each once")
    shapes = {part.shape for part in parts.values()}
    if len(shapes) > 1:
        raise ValueError(f"{path}: the slices of an array differ in size: {sorted(shapes)}")
    return np.concatenate([parts[i] for i in range(sidecar.frames)])
