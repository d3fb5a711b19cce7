"""pbrt's uniform grids (.pbrt): density as text inside a medium, x fastest. Read only.

Parameters as in pbrt-v4's ``uniformgrid`` (and v3's ``heterogeneous``): "integer nx|ny|nz", "point3 p0|p1" and
"float density". Transforms and scales around the medium are left aside.
"""

import re
import warnings
from pathlib import Path

import numpy as np

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError, check_size, checked_density, cubic_voxel, read_bounded


def read_pbrt(path: Path) -> DensityFrame:
    """Read the first grid of a file; p0 and p1, the corners of its box, are (0, 0, 0) and (1, 1, 1) by default.

    Raises VolumeError if there is no such grid, if its numbers are not those it promises, or if it is damaged.
    """
    text = re.sub(r"#[^\n]*", "", read_bounded(path).decode("utf-8", errors="replace"))
    sizes = [_numbers(path, text, "integer", f"n{axis}", 1) for axis in "xyz"]
    x, y, z = (int(size[0]) if size is not None else 1 for size in sizes)
    check_size(str(path), (z, y, x))
    density = _numbers(path, text, "float", "density", z * y * x)
    if density is None:
        raise VolumeError(f'{path}: holds no "float density" of a uniformgrid; a nanovdb medium names a .nvdb to read')
    p0, p1 = (_numbers(path, text, "point3?", name, 3) for name in ("p0", "p1"))
    first = np.zeros(3) if p0 is None else p0
    last = np.ones(3) if p1 is None else p1
    edges = (last - first) / (x, y, z)
    size = cubic_voxel(str(path), (float(edges[0]), float(edges[1]), float(edges[2])))
    origin = (float(first[0]), float(first[1]), float(first[2]))
    with np.errstate(over="ignore"):
        smoke = checked_density(str(path), density.reshape(z, y, x).astype(np.float32))
    return DensityFrame(density=smoke, grid=Grid(shape_zyx=(z, y, x), voxel_size_m=size, origin_m=origin))


def _numbers(path: Path, text: str, kind: str, name: str, count: int) -> np.ndarray | None:
    """The numbers of a parameter, with or without brackets; None if it is not there."""
    found = re.search(rf'"{kind}\s+{name}"\s*(?:\[([^\[\]"]*)\]|([^\s\[\]"]+))', text)
    if not found:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy's sign of words between the numbers
        try:
            numbers = np.fromstring(found[1] or found[2] or "", sep=" ")
        except (ValueError, DeprecationWarning) as error:
            raise VolumeError(f"{path}: {name!r} holds more than numbers; export the file again") from error
    if len(numbers) != count or not (name == "density" or (np.isfinite(numbers) & (abs(numbers) < 1e9)).all()):
        raise VolumeError(f"{path}: {name!r} holds {len(numbers)} numbers, not {count} in range; export it again")
    return numbers
