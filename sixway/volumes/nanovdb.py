"""NanoVDB files (.nvdb): one float fog grid, made dense over its index bounding box by Warp.

The header is read and bounded here before Warp sees a byte. Layout: NanoVDB file format 32
(FileHeader, FileMetaData; `nanovdb/NanoVDB.h`).
"""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes import kernels
from sixway.volumes.limits import LARGEST_FILE_BYTES, VolumeError, check_size, cubic_voxel

_MAGIC = (0x304244566F6E614E, 0x324244566F6E614E)  # "NanoVDB0", "NanoVDB2"
_FLOAT_GRID = 1
_LEVEL_SET = 1
_HEADER = struct.Struct("<QIHH")  # FileHeader: magic, version, grids, codec
_CODEC_NONE, _CODEC_ZIP = 0, 1
# FileMetaData: 176 bytes a grid, its name behind them. Its bounding boxes are not trusted: writers leave them empty.
_META_BYTES, _META_NAME_BYTES = 176, 136
# GridData and TreeData inside the payload: byte offsets of what is read here
_AFFINE, _TRANSLATION, _VOXEL_SIZE, _CLASS_AND_TYPE = 384, 528, 608, 632
_TREE, _ROOT_OFFSET = 672, 696


@dataclass(frozen=True)
class _GridEntry:
    name: str
    grid_bytes: int


def read_nanovdb(path: Path, *, grid_name: str = "density") -> DensityFrame:
    """Read the float fog grid `grid_name` (or the only grid, whatever its name).

    Raises VolumeError if the file is no NanoVDB file, is truncated, holds no such grid, or if the grid
    is a level set, no float grid, or too large.
    """
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise VolumeError(f"{path}: larger than {LARGEST_FILE_BYTES} bytes; crop or resample the grid")
    data = path.read_bytes()
    entries, payload, codec = _read_header(path, data)
    entry = _choose(path, entries, grid_name)
    grid_data = _unpack(path, data, payload, entries[: entries.index(entry) + 1], codec)
    try:
        grid, first = _read_grid(path, grid_data, entry)
    except struct.error as error:
        raise VolumeError(f"{path}: truncated grid; export it again") from error

    header = _HEADER.pack(_MAGIC[0], struct.unpack_from("<I", data, 8)[0], 1, _CODEC_NONE)
    meta = bytearray(_META_BYTES)
    struct.pack_into("<Q", meta, 8, len(grid_data))  # all that Warp reads of the metadata
    try:
        volume = wp.Volume.load_from_nvdb(header + bytes(meta) + grid_data, device="cpu")
    except RuntimeError as error:
        raise VolumeError(f"{path}: damaged NanoVDB grid ({error}); export it again") from error
    dense = wp.empty(grid.shape_zyx, dtype=float, device="cpu")
    wp.launch(kernels.densify, dim=grid.shape_zyx, inputs=[volume.id, wp.vec3i(*first)], outputs=[dense], device="cpu")
    density = dense.numpy()
    if not np.isfinite(density).all() or density.min() < 0.0:
        raise VolumeError(f"{path}: density holds NaN or negative values (lowest {np.nanmin(density):g}); repair it")
    return DensityFrame(density=density, grid=grid)


def _read_header(path: Path, data: bytes) -> tuple[list[_GridEntry], int, int]:
    """The grids of the file's first segment, the offset of their payload, and the codec."""
    try:
        magic, _, count, codec = _HEADER.unpack_from(data, 0)
        if magic not in _MAGIC:
            raise VolumeError(f"{path}: not a NanoVDB file (its first bytes are {data[:8]!r})")
        if codec not in (_CODEC_NONE, _CODEC_ZIP):
            raise VolumeError(f"{path}: compressed with Blosc; write it again with the zip codec or none")
        entries, offset = [], _HEADER.size
        for _ in range(count):
            (grid_bytes,) = struct.unpack_from("<Q", data, offset)
            (name_bytes,) = struct.unpack_from("<I", data, offset + _META_NAME_BYTES)
            name = data[offset + _META_BYTES : offset + _META_BYTES + name_bytes].rstrip(b"\0")
            entries.append(_GridEntry(name.decode("utf-8", errors="replace"), grid_bytes))
            offset += _META_BYTES + name_bytes
    except struct.error as error:
        raise VolumeError(f"{path}: truncated NanoVDB header; copy or export the file again") from error
    return entries, offset, codec


def _choose(path: Path, entries: list[_GridEntry], grid_name: str) -> _GridEntry:
    named = [entry for entry in entries if entry.name == grid_name]
    if named:
        return named[0]
    if len(entries) == 1:
        return entries[0]
    names = ", ".join(repr(entry.name) for entry in entries) or "none"
    raise VolumeError(f"{path}: holds no grid {grid_name!r} (it holds: {names}); name one of these with --grid")


def _unpack(path: Path, data: bytes, offset: int, entries: list[_GridEntry], codec: int) -> bytes:
    """The payload of the last of `entries`, walking over those before it; never more than its header tells."""
    wanted = entries[-1].grid_bytes
    if wanted > LARGEST_FILE_BYTES:
        raise VolumeError(f"{path}: its grid unpacks to {wanted} bytes, over {LARGEST_FILE_BYTES}; resample it")
    if codec == _CODEC_NONE:
        offset += sum(entry.grid_bytes for entry in entries[:-1])
        grid_data = data[offset : offset + wanted]
    else:
        try:
            for _ in entries[:-1]:
                offset += 8 + struct.unpack_from("<Q", data, offset)[0]
            (stored,) = struct.unpack_from("<Q", data, offset)
            grid_data = zlib.decompressobj().decompress(data[offset + 8 : offset + 8 + stored], wanted + 1)
        except (struct.error, zlib.error, OverflowError) as error:
            raise VolumeError(f"{path}: damaged zip payload ({error}); copy or export the file again") from error
    if len(grid_data) != wanted:
        raise VolumeError(f"{path}: its payload is not of the size that its header tells; export the file again")
    return grid_data


def _read_grid(path: Path, grid_data: bytes, entry: _GridEntry) -> tuple[Grid, tuple[int, int, int]]:
    """Where the grid lies, and the index of its first voxel. OpenVDB centres a voxel on its integer index."""
    grid_class, grid_type = struct.unpack_from("<2I", grid_data, _CLASS_AND_TYPE)
    if grid_class == _LEVEL_SET:
        raise VolumeError(f"{path}: grid {entry.name!r} is a level set, not fog; convert it to a fog volume first")
    if grid_type != _FLOAT_GRID:
        raise VolumeError(f"{path}: grid {entry.name!r} holds no floats; convert it to a float grid first")
    affine = np.array(struct.unpack_from("<9d", grid_data, _AFFINE)).reshape(3, 3)
    if not np.isfinite(affine).all() or np.abs(affine - np.diag(np.diag(affine))).max() > 1e-6 * np.abs(affine).max():
        raise VolumeError(f"{path}: grid {entry.name!r} is rotated or sheared; resample it along the world's axes")
    sizes = struct.unpack_from("<3d", grid_data, _VOXEL_SIZE)
    voxel_size = cubic_voxel(str(path), sizes)
    translation = struct.unpack_from("<3d", grid_data, _TRANSLATION)
    root = _TREE + struct.unpack_from("<Q", grid_data, _ROOT_OFFSET)[0]
    if root > len(grid_data):
        raise VolumeError(f"{path}: damaged NanoVDB tree; export it again")
    bounds = struct.unpack_from("<6i", grid_data, root)
    first = (bounds[0], bounds[1], bounds[2])
    x, y, z = (last - low + 1 for low, last in zip(first, bounds[3:], strict=True))
    check_size(str(path), (z, y, x))
    origin = tuple(t + (low - 0.5) * voxel_size for t, low in zip(translation, first, strict=True))
    return Grid(shape_zyx=(z, y, x), voxel_size_m=voxel_size, origin_m=(origin[0], origin[1], origin[2])), first
