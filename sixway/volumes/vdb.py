"""OpenVDB files (.vdb): one scalar fog grid, made dense over the box of its active voxels.

Read are file versions 222 to 224, trees 5-4-3 of float and double, half storage, zip, Blosc (numcodecs) or
none, active masks, tiles, inactive values, shared trees. Not read: streams without offsets, points, frustums.
Velocity is left aside: its unit is not told by the file (Houdini m/s, Blender its own).
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError, check_size, checked_density, cubic_voxel, read_bounded
from sixway.volumes.listing import Box, GridInfo, choose_grid, empty_grid
from sixway.volumes.vdb_format import Descriptor, read_descriptors, scale_and_translation
from sixway.volumes.vdb_tree import active_box, read_dense, read_topology
from sixway.volumes.vdb_values import KINDS


def list_vdb(path: Path, *, boxes: bool = True) -> list[GridInfo]:
    """The grids of a file, with the boxes of those whose trees can be walked. Raises VolumeError.

    boxes: whether to walk the trees at all; names and kinds stand in the header.
    """
    data = read_bounded(path)
    descriptors = read_descriptors(path, data)
    return [_info(grid, _box(path, data, grid, descriptors) if boxes else None) for grid in descriptors]


def read_vdb(path: Path, *, grid_name: str | None = None) -> DensityFrame:
    """Read a density grid; which one, `choose_grid` says.

    The frame's box is that of the active voxels. A grid without any is a frame of 8^3 zeros at index 0, since
    the first frames of a sequence often are empty. OpenVDB centres a voxel on its integer index.
    Raises VolumeError for what is no fog, not axis-aligned, too large, damaged, or Blosc without numcodecs.
    """
    values, grid = read_vdb_values(path, grid_name=grid_name)
    return DensityFrame(density=checked_density(str(path), values), grid=grid)


def read_vdb_values(path: Path, *, grid_name: str | None) -> tuple[Float[np.ndarray, "z y x"], Grid]:
    """The values of a scalar grid as they stand in the file, which may be negative or NaN; else as `read_vdb`."""
    data = read_bounded(path)
    descriptors = read_descriptors(path, data)
    chosen = descriptors[choose_grid(path, [_info(grid, None) for grid in descriptors], grid_name)]
    source = f"{path} ({chosen.name!r})"
    scale, translation = scale_and_translation(str(path), chosen)
    edge = cubic_voxel(str(path), (float(scale[0]), float(scale[1]), float(scale[2])))
    owner = _owner(path, chosen, descriptors)
    tree = read_topology(str(path), data, owner)
    box = active_box(tree)
    first = np.array(box[0] if box else (0, 0, 0))
    x, y, z = translation + (first - 0.5) * scale
    origin = (float(x), float(y), float(z))
    if box is None:
        grid = empty_grid(voxel_size_m=edge, origin_m=origin)
        return np.zeros(grid.shape_zyx, np.float32), grid
    size_x, size_y, size_z = (last - low + 1 for low, last in zip(*box, strict=True))
    check_size(source, (size_z, size_y, size_x))
    values = read_dense(str(path), data, tree, owner.blocks_at, box)
    return values, Grid(shape_zyx=values.shape, voxel_size_m=edge, origin_m=origin)


def _info(grid: Descriptor, box: Box | None) -> GridInfo:
    return GridInfo(name=grid.name, kind=grid.kind, grid_class=grid.grid_class, box=box)


def _owner(path: Path, grid: Descriptor, descriptors: list[Descriptor]) -> Descriptor:
    """The grid that holds the tree: itself, or the one whose tree it shares."""
    if not grid.parent:
        return grid
    for other in descriptors:
        if other.unique_name == grid.parent and not other.parent:
            return other
    raise VolumeError(f"{path}: grid {grid.name!r} shares the tree of {grid.parent!r}, which is not in the file")


def _box(path: Path, data: bytes, grid: Descriptor, descriptors: list[Descriptor]) -> Box | None:
    owner = _owner(path, grid, descriptors)
    if owner.kind not in KINDS:
        return None
    return active_box(read_topology(str(path), data, owner))
