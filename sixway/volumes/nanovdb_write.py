"""Writing NanoVDB files (.nvdb): Warp builds the grid, the labels that it leaves out are put in here.

Warp leaves name, class and boxes empty and pads the volume to whole leaves; renderers and our own reader want the
frame's box. Layout as in `nanovdb`.
"""

import struct
import zlib
from pathlib import Path

import numpy as np
import warp as wp

from sixway.core.records import DensityFrame
from sixway.core.store import atomic_path
from sixway.volumes import nanovdb

_NAME = b"density\0"
_NO_CHECKSUM = 0xFFFFFFFFFFFFFFFF  # NanoVDB's mark for "not computed": the bytes below change the content
_CHECKSUM, _GRID_NAME, _INVERSE, _WORLD_BOX = 8, 40, 456, 560  # offsets in GridData
_NODE_COUNTS, _VOXEL_COUNT = 704, 728  # offsets of TreeData's counts: nodes and tiles of three levels; active voxels


def write_nanovdb(path: Path, frame: DensityFrame) -> None:
    """Write the density of a frame atomically, zip codec; all else is left out."""
    z, y, x = frame.density.shape
    edge = frame.grid.voxel_size_m
    volume = wp.Volume.load_from_numpy(
        np.ascontiguousarray(frame.density.transpose(2, 1, 0)),
        min_world=tuple(o + 0.5 * edge for o in frame.grid.origin_m),  # the centre of voxel 0
        voxel_size=edge,
        device="cpu",
    )
    grid = bytearray(volume.array().numpy().tobytes())
    last_m = [o + length for o, length in zip(frame.grid.origin_m, frame.grid.extent_m, strict=True)]
    world_box = struct.pack("<6d", *frame.grid.origin_m, *last_m)
    index_box = struct.pack("<6i", 0, 0, 0, x - 1, y - 1, z - 1)
    class_and_type = struct.pack("<2I", nanovdb.FOG_VOLUME, nanovdb.FLOAT_GRID)
    centre = struct.pack("<3d", *(o + 0.5 * edge for o in frame.grid.origin_m))
    for offset, value in (
        # Warp's transform is rounded to float
        (nanovdb.AFFINE, _diagonal(edge)),
        (_INVERSE, _diagonal(1.0 / edge)),
        (nanovdb.TRANSLATION, centre),
        (nanovdb.VOXEL_SIZE, struct.pack("<3d", edge, edge, edge)),
        (_CHECKSUM, struct.pack("<Q", _NO_CHECKSUM)),
        (_GRID_NAME, _NAME.ljust(256, b"\0")),
        (_WORLD_BOX, world_box),
        (nanovdb.CLASS_AND_TYPE, class_and_type),
        (nanovdb.root_offset(bytes(grid[:1024])), index_box),
    ):
        grid[offset : offset + len(value)] = value

    payload = zlib.compress(grid, 1)
    counts = bytes(grid[_NODE_COUNTS:_VOXEL_COUNT])
    meta = struct.pack("<3Q", len(grid), len(payload), _name_key(_NAME.rstrip(b"\0")))
    meta += bytes(grid[_VOXEL_COUNT : _VOXEL_COUNT + 8])
    meta += struct.pack("<2I", nanovdb.FLOAT_GRID, nanovdb.FOG_VOLUME) + world_box + index_box
    meta += struct.pack("<3dI", edge, edge, edge, len(_NAME)) + counts[:12] + struct.pack("<I", 1) + counts[12:]
    meta += struct.pack("<2HI", nanovdb.CODEC_ZIP, 0, nanovdb.VERSION)
    assert len(meta) == nanovdb.META_BYTES
    header = nanovdb.HEADER.pack(nanovdb.MAGIC, nanovdb.VERSION, 1, nanovdb.CODEC_ZIP)
    with atomic_path(path) as temporary:
        temporary.write_bytes(header + meta + _NAME + struct.pack("<Q", len(payload)) + payload)


def _diagonal(value: float) -> bytes:
    return struct.pack("<9d", value, 0, 0, 0, value, 0, 0, 0, value)


def _name_key(name: bytes) -> int:
    """NanoVDB's hash of a grid's name (`nanovdb/io/IO.h`, stringHash), by which its readers look grids up."""
    key = 0
    for letter in name:
        overflow = key >> 56
        key = (key * 67 + letter + overflow) & 0xFFFFFFFFFFFFFFFF
    return key
