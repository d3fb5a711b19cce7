"""What a volume file holds, and which of its grids is the smoke."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sixway.core.frames import Grid
from sixway.volumes.limits import VolumeError

GridClass = Literal["fog volume", "level set", "staggered", "unknown"]
Box = tuple[tuple[int, int, int], tuple[int, int, int]]

_SCALARS = ("float", "double")
EMPTY_EDGE = 8


@dataclass(frozen=True, kw_only=True)
class GridInfo:
    """One grid of a file. kind: type of its values, as ``float``, ``double``, ``vec3s``, ``points``.

    box: first and last (x, y, z) index that is active, both inclusive, negative ones allowed; None if the
    grid is empty or its box is not known.
    """

    name: str
    kind: str
    grid_class: GridClass
    box: Box | None = None

    @property
    def is_smoke(self) -> bool:
        """Whether the grid may be read as density."""
        return self.kind in _SCALARS and self.grid_class in ("fog volume", "unknown")

    def __str__(self) -> str:
        kind = "" if self.grid_class == "unknown" else f", {self.grid_class}"
        return f"{self.name!r} ({self.kind}{kind})"


def choose_grid(path: Path, grids: list[GridInfo], wanted: str | None) -> int:
    """Index of the grid of that name; for None or "density" also the only smoke grid, whatever its name.

    Raises VolumeError that lists the grids, or tells why the one named is no density.
    """
    held = ", ".join(map(str, grids)) or "none"
    name = "density" if wanted is None else wanted
    named = [index for index, grid in enumerate(grids) if grid.name == name]
    if not named and name == "density":
        named = [index for index, grid in enumerate(grids) if grid.is_smoke]
        if not named and len(grids) == 1:
            named = [0]  # so that the message tells what is wrong with the only grid
        if len(named) > 1:
            named = []
    if not named:
        raise VolumeError(
            f"{path}: holds no grid {wanted or 'density'!r} (it holds: {held}); name one of these with --grid"
        )
    grid = grids[named[0]]
    if grid.grid_class == "level set":
        raise VolumeError(
            f"{path}: grid {grid.name!r} is a level set, not fog; convert it to a fog volume first (Houdini: "
            f"Convert VDB; OpenVDB: sdfToFogVolume), or name another grid with --grid (it holds: {held})"
        )
    if grid.kind == "points":
        raise VolumeError(
            f"{path}: grid {grid.name!r} holds points, not density; rasterise them to a float fog volume first"
        )
    if not grid.is_smoke:
        raise VolumeError(
            f"{path}: grid {grid.name!r} holds {grid.kind} values, not density; name a float grid with --grid "
            f"(it holds: {held}) or convert it to float"
        )
    return named[0]


def empty_grid(*, voxel_size_m: float, origin_m: tuple[float, float, float]) -> Grid:
    """The box that stands for a grid without any active voxel, as the first frames of a fire have them."""
    return Grid(shape_zyx=(EMPTY_EDGE,) * 3, voxel_size_m=voxel_size_m, origin_m=origin_m)
