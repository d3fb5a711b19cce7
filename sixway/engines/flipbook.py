"""Frames to flipbooks and back: which source frames a book shows, and where their tiles lie.

A flipbook is a plan before it is pixels: each shown frame is a weighted sum of source frames. Loop, retime
and decimate change the plan; pixels are blended once, while the book is put together.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Plan = tuple[tuple[tuple[int, float], ...], ...]
"""For each shown frame its (source frame, weight) pairs; weights of one frame sum to 1."""


@dataclass(frozen=True)
class TileGrid:
    """columns x rows tiles, filled row by row from the top left."""

    columns: int
    rows: int

    def __post_init__(self) -> None:
        if not (1 <= self.columns <= 256 and 1 <= self.rows <= 256):
            raise ValueError(f"grid {self.columns}x{self.rows} must have 1 to 256 columns and rows")

    @property
    def tiles(self) -> int:
        return self.columns * self.rows

    def tile_shape(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) of one tile [px]. Raises ValueError unless tiles are whole pixels."""
        if height % self.rows or width % self.columns:
            raise ValueError(
                f"a picture of {width} x {height} px does not hold {self.columns}x{self.rows} tiles of whole pixels; "
                "give the grid that it was made with"
            )
        return height // self.rows, width // self.columns


def parse_grid(text: str, frames: int) -> TileGrid:
    """``8x8`` (columns x rows), or ``auto``: the squarest grid that leaves no row empty. Raises ValueError."""
    if text == "auto":
        columns = math.ceil(math.sqrt(frames))
        return TileGrid(columns, math.ceil(frames / columns))
    columns_text, x, rows_text = text.lower().partition("x")
    if not (x and columns_text.isdecimal() and rows_text.isdecimal()):
        raise ValueError(f"grid {text!r} must be COLUMNSxROWS, such as 8x8, or auto")
    return TileGrid(int(columns_text), int(rows_text))


def every_frame(count: int) -> Plan:
    """The frames as they are."""
    return tuple(((i, 1.0),) for i in range(count))


def blend(plan: Plan, weights: Plan) -> Plan:
    """The plan whose frames are `weights` sums of the frames of `plan`."""
    frames = []
    for mix in weights:
        sums: dict[int, float] = {}
        for shown, weight in mix:
            for source, part in plan[shown]:
                sums[source] = sums.get(source, 0.0) + weight * part
        frames.append(tuple((source, part) for source, part in sorted(sums.items()) if part > 0.0))
    return tuple(frames)


def loop(plan: Plan, crossfade: int) -> Plan:
    """Fade the last `crossfade` frames into the first ones; the loop is that many frames shorter.

    Shown frame i < crossfade mixes source frame i, weight (i + 1) / (crossfade + 1), with the frame that
    would have followed the end, so that the step from the last frame to the first is one frame's step.
    Raises ValueError unless 0 < crossfade <= half of the frames.
    """
    count = len(plan)
    if not 0 < crossfade <= count // 2:
        raise ValueError(f"a crossfade of {crossfade} frames needs 1 to {count // 2} of the {count} frames")
    length = count - crossfade
    weights: list[tuple[tuple[int, float], ...]] = []
    for i in range(length):
        part = (i + 1) / (crossfade + 1)
        weights.append(((i, part), (length + i, 1.0 - part)) if i < crossfade else ((i, 1.0),))
    return blend(plan, tuple(weights))


def retime(plan: Plan, count: int, *, closed: bool = False) -> Plan:
    """`count` frames spread evenly over the same time, neighbours blended linearly.

    First and last frame stay, unless the plan is a loop (`closed`), whose last frame leads to the first.
    Raises ValueError for count < 1.
    """
    if count < 1:
        raise ValueError(f"cannot retime to {count} frames; give 1 or more")
    total = len(plan)
    step = total / count if closed else (total - 1) / max(count - 1, 1)
    weights = []
    for i in range(count):
        first, part = divmod(i * step, 1.0)
        a = int(first)
        b = (a + 1) % total if closed else min(a + 1, total - 1)
        weights.append(((a, 1.0 - part), (b, part)) if part > 1e-9 and a != b else ((a, 1.0),))
    return blend(plan, tuple(weights))


def decimate(plan: Plan, every: int) -> Plan:
    """Frames 0, every, 2 every, ... Raises ValueError for every < 1."""
    if every < 1:
        raise ValueError(f"cannot keep every {every}th frame; give 1 or more")
    return plan[::every]


def border_ramp(height: int, width: int, border_px: int) -> Float[np.ndarray, "h w"]:
    """1 inside, a smooth fall to 0 on the outermost pixels, over `border_px` pixels.

    With black rims, bilinear filtering and the first mips take nothing from the neighbouring tile. Raises
    ValueError where the border leaves nothing of the tile.
    """
    if not 0 <= border_px <= min(height, width) // 2 - 1:
        raise ValueError(f"a border of {border_px} px does not fit tiles of {width} x {height} px; make it narrower")
    if border_px == 0:
        return np.ones((height, width), np.float32)

    def along(size: int) -> np.ndarray:
        inwards = np.minimum(np.arange(size), np.arange(size)[::-1])
        t = np.clip(inwards / border_px, 0.0, 1.0)
        return t * t * (3.0 - 2.0 * t)

    return np.outer(along(height), along(width)).astype(np.float32)


def shown_frame(plan: Plan, number: int, read: Callable[[int], np.ndarray]) -> Float[np.ndarray, "h w c"]:
    """One frame of a plan: the weighted sum of the source frames that `read` gives."""
    (first, weight), *rest = plan[number]
    image = read(first) if weight == 1.0 else np.float32(weight) * read(first)
    for source, part in rest:
        image = image + np.float32(part) * read(source)
    return image


def place(atlas: np.ndarray, tile: np.ndarray, number: int, grid: TileGrid) -> None:
    """Write frame `number` into its tile of `atlas` [rows h, columns w, c]."""
    height, width = tile.shape[:2]
    row, column = divmod(number, grid.columns)
    atlas[row * height : (row + 1) * height, column * width : (column + 1) * width] = tile


def split(atlas: Float[np.ndarray, "H W c"], grid: TileGrid, frames: int) -> Float[np.ndarray, "n h w c"]:
    """The first `frames` tiles of a flipbook, row by row from the top left. Raises ValueError if there are fewer."""
    if not 1 <= frames <= grid.tiles:
        raise ValueError(f"{frames} frames do not fit a grid of {grid.columns}x{grid.rows} tiles")
    height, width = grid.tile_shape(*atlas.shape[:2])
    tiles = atlas.reshape(grid.rows, height, grid.columns, width, -1).swapaxes(1, 2)
    return tiles.reshape(grid.tiles, height, width, -1)[:frames]
