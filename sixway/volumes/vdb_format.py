"""The outer layers of an OpenVDB file (.vdb): header, grid descriptors, metadata, transform.

Layout after `openvdb/io/Archive.cc`, `GridDescriptor.cc`, `MetaMap.cc` and `math/Maps.h`, file versions 222
(per-node mask compression) to 224. All numbers are little-endian.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sixway.volumes.limits import VolumeError
from sixway.volumes.listing import GridClass

MAGIC = b" BDV\0\0\0\0"
OLDEST_VERSION, VERSION = 222, 224
ZIP, ACTIVE_MASK, BLOSC = 1, 2, 4

_HALF_SUFFIX = "_HalfFloat"
_NAME_END = "\x1e"  # behind it a number tells grids of one name apart; an unnamed grid is only that number
_CLASSES: dict[bytes, GridClass] = {b"fog volume": "fog volume", b"level set": "level set", b"staggered": "staggered"}
_VECTOR_MAPS = {
    # map: where its translation and its scale stand among its (x, y, z) vectors, and how many of them it has
    "UniformScaleMap": (None, 0, 5),
    "ScaleMap": (None, 0, 5),
    "TranslationMap": (0, None, 1),
    "UniformScaleTranslateMap": (0, 1, 6),
    "ScaleTranslateMap": (0, 1, 6),
}


class Cursor:
    """A place in the bytes of a file; every step is checked against the end."""

    def __init__(self, source: str, data: bytes, position: int = 0) -> None:
        self.source, self.data, self.position = source, data, position

    def skip(self, count: int) -> int:
        """Step over `count` bytes; the position before them."""
        start = self.position
        if count < 0 or start < 0 or start + count > len(self.data):
            raise VolumeError(
                f"{self.source}: truncated or damaged ({count} bytes are due at byte {start} of {len(self.data)}); "
                "copy or export the file again"
            )
        self.position = start + count
        return start

    def take(self, count: int) -> bytes:
        start = self.skip(count)
        return self.data[start : start + count]

    def unpack(self, layout: str) -> tuple[Any, ...]:
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def number(self, layout: str) -> Any:
        return self.unpack(layout)[0]

    def text(self) -> str:
        return self.take(self.number("I")).decode("utf-8", errors="replace")


@dataclass(frozen=True, kw_only=True)
class Descriptor:
    """One grid of the file before its tree is read.

    unique_name: its name in the file; parent: unique name of the grid whose tree it shares, or "".
    kind: value type (``float``, ``double``, ``vec3s``, ...); half: its values are stored as 16-bit floats.
    grid_at, blocks_at, end_at: byte offsets of its tree's topology, of its leaf buffers, and behind it.
    map_name, map_values: its transform, not judged yet.
    """

    unique_name: str
    parent: str
    kind: str
    half: bool
    compression: int
    metadata: dict[str, bytes]
    map_name: str
    map_values: np.ndarray
    tree_at: int
    blocks_at: int
    end_at: int

    @property
    def name(self) -> str:
        return self.unique_name.partition(_NAME_END)[0]

    @property
    def grid_class(self) -> GridClass:
        return _CLASSES.get(self.metadata.get("class", b""), "unknown")


def read_descriptors(path: Path, data: bytes) -> list[Descriptor]:
    """The grids of a file. Raises VolumeError for other files, other versions, streams, and damage."""
    cursor = Cursor(str(path), data)
    if data[:8] != MAGIC:
        raise VolumeError(f"{path}: not an OpenVDB file (its first bytes are {data[:8]!r})")
    cursor.skip(8)
    version, _, _, has_offsets = cursor.unpack("IIIB")
    if not OLDEST_VERSION <= version <= VERSION:
        raise VolumeError(
            f"{path}: OpenVDB file version {version}; {OLDEST_VERSION} to {VERSION} are read: save it again with "
            "OpenVDB 3 to 12 (Houdini, Blender)"
        )
    if not has_offsets:
        raise VolumeError(f"{path}: a streamed .vdb without grid offsets; save it again as a file (openvdb io::File)")
    cursor.skip(36)  # UUID
    _metadata(cursor)
    grids = []
    for _ in range(max(cursor.number("i"), 0)):
        start = cursor.position
        grids.append(_descriptor(cursor))
        if grids[-1].end_at <= start:  # a grid that ends before it starts would be read for ever
            raise VolumeError(f"{path}: damaged grid offsets; copy or export the file again")
        cursor.position = grids[-1].end_at
    return grids


def _descriptor(cursor: Cursor) -> Descriptor:
    unique_name, tree, parent = cursor.text(), cursor.text(), cursor.text()
    grid_at, blocks_at, end_at = cursor.unpack("3q")
    cursor.position = grid_at
    compression = cursor.number("I")
    metadata = _metadata(cursor)
    map_name = cursor.text()
    half = tree.endswith(_HALF_SUFFIX)
    tree = tree.removesuffix(_HALF_SUFFIX)
    kind = tree.removeprefix("Tree_").removesuffix("_5_4_3") if tree.endswith("_5_4_3") else tree
    if map_name in _VECTOR_MAPS:
        count = 3 * _VECTOR_MAPS[map_name][2]
    else:
        count = 16 if map_name in ("AffineMap", "UnitaryMap") else 0
    return Descriptor(
        unique_name=unique_name,
        parent=parent,
        kind="points" if kind.startswith("pt") else kind,
        half=half,
        compression=compression,
        metadata=metadata,
        map_name=map_name,
        map_values=np.array(cursor.unpack(f"{count}d")),
        tree_at=cursor.position,
        blocks_at=blocks_at,
        end_at=end_at,
    )


def _metadata(cursor: Cursor) -> dict[str, bytes]:
    """Names and raw values; a value's length stands before it, so types that nobody knows do no harm."""
    values = {}
    for _ in range(cursor.number("I")):
        name, _ = cursor.text(), cursor.text()
        values[name] = cursor.take(cursor.number("I"))
    return values


def scale_and_translation(source: str, grid: Descriptor) -> tuple[np.ndarray, np.ndarray]:
    """(x, y, z) edges of a voxel and the world position of the centre of voxel 0 [m].

    Raises VolumeError for frustums and for grids that are rotated, sheared or mirrored.
    """
    values = grid.map_values
    if grid.map_name in _VECTOR_MAPS:
        translation_row, scale_row, _ = _VECTOR_MAPS[grid.map_name]
        rows = values.reshape(-1, 3)
        scale = np.ones(3) if scale_row is None else rows[scale_row]
        translation = np.zeros(3) if translation_row is None else rows[translation_row]
    elif values.size == 16:
        matrix = values.reshape(4, 4)  # row vectors: its last row is the translation
        scale, translation = np.diag(matrix)[:3], matrix[3, :3]
        with np.errstate(invalid="ignore", over="ignore"):
            off_diagonal = np.abs(matrix[:3, :3] - np.diag(scale)).max()
            if not off_diagonal <= 1e-6 * np.abs(scale).max():
                raise VolumeError(
                    f"{source}: grid {grid.name!r} is rotated or sheared; resample it along the world's axes"
                )
    else:
        raise VolumeError(
            f"{source}: grid {grid.name!r} has a transform {grid.map_name!r}, whose voxels are no cubes along the "
            "world's axes; resample it to a uniform grid (Houdini: VDB Resample)"
        )
    if not (np.isfinite(translation).all() and np.abs(translation).max() < 1e30):
        raise VolumeError(f"{source}: grid {grid.name!r} lies at {tuple(translation)}; repair its transform")
    return scale, translation
