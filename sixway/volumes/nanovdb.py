"""NanoVDB files (.nvdb): one float fog grid, made dense over its index bounding box by Warp.

The header is read and bounded here before Warp sees a byte; Warp validates the tree behind it.
Layout: NanoVDB file format 32 (FileHeader, FileMetaData; `nanovdb/NanoVDB.h`).
"""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes import kernels
from sixway.volumes.limits import (
    LARGEST_FILE_BYTES,
    VolumeError,
    check_size,
    checked_density,
    cubic_voxel,
    read_bounded,
)
from sixway.volumes.listing import Box, GridClass, GridInfo, choose_grid, empty_grid

MAGIC = 0x304244566F6E614E  # "NanoVDB0"
_MAGICS = (MAGIC, 0x324244566F6E614E)  # and "NanoVDB2"
FLOAT_GRID, FOG_VOLUME = 1, 2
_LEVEL_SET = 1
HEADER = struct.Struct("<QIHH")  # FileHeader: magic, version, grids, codec
CODEC_NONE, CODEC_ZIP = 0, 1
VERSION = 32 << 21 | 3 << 10 | 3  # 32.3.3
# FileMetaData: 176 bytes a grid, its name behind them. Its bounding boxes are not trusted: writers leave them empty.
META_BYTES, _META_TYPE_AND_CLASS, _META_NAME_BYTES = 176, 32, 136
# GridData and TreeData inside the payload: byte offsets of what is read here
AFFINE, TRANSLATION, VOXEL_SIZE, CLASS_AND_TYPE = 384, 528, 608, 632
TREE, _ROOT_OFFSET = 672, 696

_KINDS = {0: "float", 1: "float", 2: "double", 3: "int16", 4: "int32", 5: "int64", 6: "vec3s", 7: "vec3d", 8: "mask"}
_CLASSES: dict[int, GridClass] = {1: "level set", 2: "fog volume", 3: "staggered"}
_POINT_CLASSES = (4, 5)


@dataclass(frozen=True)
class _GridEntry:
    """One grid: what the metadata says of it, and where its `stored` bytes are in the file."""

    info: GridInfo
    grid_bytes: int
    codec: int
    stored_at: int
    stored: int


def list_nanovdb(path: Path, *, boxes: bool = True) -> list[GridInfo]:
    """The grids of a file with their boxes. Raises VolumeError for other files and damage.

    boxes: whether to unpack the grids at all; names and kinds stand in the header.
    """
    data = read_bounded(path)
    entries = _read_entries(path, data)
    return [_with_box(path, entry, _unpack(path, data, entry)) if boxes else entry.info for entry in entries]


def read_nanovdb(path: Path, *, grid_name: str | None = None) -> DensityFrame:
    """Read a float grid over its index box; which one, `choose_grid` says. An empty grid is 8^3 zeros.

    Raises VolumeError if the file is no NanoVDB file, is truncated, holds no such grid, or if the grid
    is a level set, no float grid, or too large.
    """
    values, grid = read_nanovdb_values(path, grid_name=grid_name)
    return DensityFrame(density=checked_density(str(path), values), grid=grid)


def read_nanovdb_values(path: Path, *, grid_name: str | None) -> tuple[Float[np.ndarray, "z y x"], Grid]:
    """The values of a float grid as they stand in the file, which may be negative or NaN; else as `read_nanovdb`."""
    data = read_bounded(path)
    entries = _read_entries(path, data)
    entry = entries[choose_grid(path, [entry.info for entry in entries], grid_name)]
    grid_data = _unpack(path, data, entry)
    try:
        grid, box = _read_grid(path, grid_data, entry.info.name)
    except struct.error as error:
        raise VolumeError(f"{path}: truncated grid; export it again") from error
    if box is None:
        return np.zeros(grid.shape_zyx, np.float32), grid
    header = HEADER.pack(MAGIC, VERSION, 1, CODEC_NONE)
    meta = bytearray(META_BYTES)
    struct.pack_into("<Q", meta, 8, len(grid_data))  # all that Warp reads of the metadata
    try:
        volume = wp.Volume.load_from_nvdb(header + bytes(meta) + grid_data, device="cpu")
    except RuntimeError as error:
        raise VolumeError(f"{path}: damaged NanoVDB grid ({error}); export it again") from error
    dense = wp.empty(grid.shape_zyx, dtype=float, device="cpu")
    inputs = [volume.id, wp.vec3i(*box[0])]
    wp.launch(kernels.densify, dim=grid.shape_zyx, inputs=inputs, outputs=[dense], device="cpu")
    return dense.numpy(), grid


def _read_entries(path: Path, data: bytes) -> list[_GridEntry]:
    """The grids of all segments of the file; converters write one segment a grid."""
    entries: list[_GridEntry] = []
    offset = 0
    try:
        while offset < len(data) or not entries:
            magic, _, count, codec = HEADER.unpack_from(data, offset)
            if magic not in _MAGICS:
                raise VolumeError(f"{path}: not a NanoVDB file (it has {data[offset : offset + 8]!r} at byte {offset})")
            if codec not in (CODEC_NONE, CODEC_ZIP):
                raise VolumeError(f"{path}: compressed with Blosc; write it again with the zip codec or none")
            offset += HEADER.size
            metas = []
            for _ in range(count):
                (grid_bytes,) = struct.unpack_from("<Q", data, offset)
                (name_bytes,) = struct.unpack_from("<I", data, offset + _META_NAME_BYTES)
                name = data[offset + META_BYTES : offset + META_BYTES + name_bytes].rstrip(b"\0")
                kind, grid_class = struct.unpack_from("<2I", data, offset + _META_TYPE_AND_CLASS)
                metas.append((_info(name, kind, grid_class), grid_bytes))
                offset += META_BYTES + name_bytes
            for info, grid_bytes in metas:
                stored = grid_bytes
                if codec == CODEC_ZIP:
                    (stored,) = struct.unpack_from("<Q", data, offset)
                    offset += 8
                entries.append(_GridEntry(info, grid_bytes, codec, offset, stored))
                offset += stored
            if not metas:
                break
    except struct.error as error:
        raise VolumeError(f"{path}: truncated NanoVDB header; copy or export the file again") from error
    return entries


def _info(name: bytes, kind: int, grid_class: int) -> GridInfo:
    return GridInfo(
        name=name.decode("utf-8", errors="replace"),
        kind="points" if grid_class in _POINT_CLASSES else _KINDS.get(kind, f"quantised or other ({kind})"),
        grid_class=_CLASSES.get(grid_class, "unknown"),
    )


def _unpack(path: Path, data: bytes, entry: _GridEntry) -> bytes:
    """The payload of a grid, never more than its header tells."""
    wanted = entry.grid_bytes
    if wanted > LARGEST_FILE_BYTES:
        raise VolumeError(f"{path}: its grid unpacks to {wanted} bytes, over {LARGEST_FILE_BYTES}; resample it")
    grid_data = data[entry.stored_at : entry.stored_at + entry.stored]
    if entry.codec == CODEC_ZIP:
        try:
            grid_data = zlib.decompressobj().decompress(grid_data, wanted + 1)
        except (zlib.error, OverflowError) as error:
            raise VolumeError(f"{path}: damaged zip payload ({error}); copy or export the file again") from error
    if len(grid_data) != wanted:
        raise VolumeError(f"{path}: its payload is not of the size that its header tells; export the file again")
    return grid_data


def _box(path: Path, grid_data: bytes) -> Box | None:
    """First and last index of the root's bounding box; None for an empty grid, whose box is turned inside out."""
    root = root_offset(grid_data)
    if root + 24 > len(grid_data):
        raise VolumeError(f"{path}: damaged NanoVDB tree; export it again")
    x0, y0, z0, x1, y1, z1 = struct.unpack_from("<6i", grid_data, root)
    return None if x1 < x0 and y1 < y0 and z1 < z0 else ((x0, y0, z0), (x1, y1, z1))


def root_offset(grid_data: bytes) -> int:
    """Where the root node starts; its first six integers are the index box."""
    return int(TREE + struct.unpack_from("<Q", grid_data, _ROOT_OFFSET)[0])


def _with_box(path: Path, entry: _GridEntry, grid_data: bytes) -> GridInfo:
    info = entry.info
    box = _box(path, grid_data) if len(grid_data) > _ROOT_OFFSET + 8 else None
    return GridInfo(name=info.name, kind=info.kind, grid_class=info.grid_class, box=box)


def _read_grid(path: Path, grid_data: bytes, name: str) -> tuple[Grid, Box | None]:
    """Where the grid lies, and its index box, None if it is empty.

    OpenVDB centres a voxel on its integer index. The class in the payload counts, not that of the metadata.
    """
    grid_class, grid_type = struct.unpack_from("<2I", grid_data, CLASS_AND_TYPE)
    if grid_class == _LEVEL_SET:
        raise VolumeError(f"{path}: grid {name!r} is a level set, not fog; convert it to a fog volume first")
    if grid_type != FLOAT_GRID:
        raise VolumeError(f"{path}: grid {name!r} holds no floats; convert it to a float grid first")
    affine = np.array(struct.unpack_from("<9d", grid_data, AFFINE)).reshape(3, 3)
    with np.errstate(invalid="ignore", over="ignore"):
        straight = np.abs(affine - np.diag(np.diag(affine))).max() <= 1e-6 * np.abs(affine).max()
    if not np.isfinite(affine).all() or not straight:
        raise VolumeError(f"{path}: grid {name!r} is rotated or sheared; resample it along the world's axes")
    voxel_size = cubic_voxel(str(path), struct.unpack_from("<3d", grid_data, VOXEL_SIZE))
    translation = struct.unpack_from("<3d", grid_data, TRANSLATION)
    if not np.isfinite(translation).all():
        raise VolumeError(f"{path}: grid {name!r} lies at {translation}; repair its transform")
    box = _box(path, grid_data)
    first, last = box or ((0, 0, 0), (0, 0, 0))
    origin = tuple(t + (low - 0.5) * voxel_size for t, low in zip(translation, first, strict=True))
    corner = (origin[0], origin[1], origin[2])
    if box is None:
        return empty_grid(voxel_size_m=voxel_size, origin_m=corner), None
    x, y, z = (end - low + 1 for low, end in zip(first, last, strict=True))
    check_size(str(path), (z, y, x))
    return Grid(shape_zyx=(z, y, x), voxel_size_m=voxel_size, origin_m=corner), box
