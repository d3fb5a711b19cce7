"""How a node of an OpenVDB tree stores its values: a flag, what its inactive values are, and one chunk.

After `openvdb/io/Compression.h` (readCompressedValues) and `Compression.cc`. With mask compression a node stores
only its active values; at most two different inactive values stand beside them, with a mask that tells which
is where. The chunk is raw, or zlib, or Blosc.
"""

import importlib
import struct
import zlib
from typing import Any, NamedTuple

import numpy as np

from sixway.volumes.limits import VolumeError
from sixway.volumes.vdb_format import ACTIVE_MASK, BLOSC, ZIP, Cursor, Descriptor

# Flags: what the inactive values are. + background, - background, one other, two of these by a mask, or all are stored
_PLUS, _, _ONE, _MASK_BOTH_SIGNS, _MASK_ONE, _MASK_TWO, ALL_STORED = range(7)
_BLOSC_HEADER = struct.Struct("<4B3I")  # versions, flags, type size; bytes unpacked, block size, bytes packed

# Value types whose size is known, so that their trees can be walked: element type and number of components
KINDS = {
    "float": ("<f4", 1),
    "double": ("<f8", 1),
    "vec3s": ("<f4", 3),
    "vec3d": ("<f8", 3),
    "vec3i": ("<i4", 3),
    "int32": ("<i4", 1),
    "int64": ("<i8", 1),
    "bool": ("u1", 1),
}


class Stored(NamedTuple):
    """Where a node's values are. num_stored: how many are in the chunk. inactive: the two values of the others.

    selection_at: byte offset of the mask that is 1 where the second inactive value stands, or -1.
    chunk_at, chunk_bytes: the chunk in the file; packed: whether it is compressed.
    """

    num_stored: int
    all_stored: bool
    inactive: tuple[float, float]
    selection_at: int
    chunk_at: int
    chunk_bytes: int
    packed: bool


class ValueFormat:
    """What all nodes of one grid share: types, compression, background. Makes and decodes `Stored`."""

    def __init__(self, source: str, grid: Descriptor, cursor: Cursor) -> None:
        """Reads the background value at the cursor."""
        element, components = KINDS[grid.kind]
        self.source = source
        self.name = grid.name
        self.value_type = np.dtype(element)
        self.value_bytes = self.value_type.itemsize * components
        self.stored_type = np.dtype("<f2") if grid.half and self.value_type.kind == "f" else self.value_type
        self.stored_bytes = self.stored_type.itemsize * components
        self.compression = grid.compression
        self.background = self._value(cursor)

    def _value(self, cursor: Cursor) -> float:
        """One value, never halved; of a vector its x, which is all that is told of it."""
        return float(np.frombuffer(cursor.take(self.value_bytes), self.value_type)[0])

    def tile(self, cursor: Cursor) -> float:
        """The value of a tile of the root."""
        return self._value(cursor)

    def locate(self, cursor: Cursor, active: int, size: int) -> Stored:
        """Step over the values of a node of `size` places, `active` of which are active."""
        flag = cursor.data[cursor.skip(1)]
        if flag > ALL_STORED:
            raise VolumeError(f"{self.source}: damaged node of grid {self.name!r} (flag {flag}); export it again")
        first = self.background if flag == _PLUS else -self.background
        second = self.background
        if flag in (_ONE, _MASK_ONE, _MASK_TWO):
            first = self._value(cursor)
        if flag == _MASK_TWO:
            second = self._value(cursor)
        selection = cursor.skip(size // 8) if flag in (_MASK_BOTH_SIGNS, _MASK_ONE, _MASK_TWO) else -1
        all_stored = flag == ALL_STORED or not self.compression & ACTIVE_MASK
        count = size if all_stored else active
        chunk_bytes, packed = count * self.stored_bytes, False
        if self.compression & (ZIP | BLOSC) and (count or self.stored_type == self.value_type):
            (word,) = struct.unpack_from("<q", cursor.data, cursor.skip(8))
            packed = word > 0
            if not packed and -word != chunk_bytes:
                raise VolumeError(
                    f"{self.source}: damaged node of grid {self.name!r} (a chunk of {-word} bytes, not "
                    f"{chunk_bytes}); export it again"
                )
            chunk_bytes = max(word, -word)
        return Stored(count, all_stored, (first, second), selection, cursor.skip(chunk_bytes), chunk_bytes, packed)

    def unpack(self, data: bytes, stored: Stored) -> bytes:
        """The chunk's values as plain bytes, exactly `num_stored` of them."""
        chunk = data[stored.chunk_at : stored.chunk_at + stored.chunk_bytes]
        due = stored.num_stored * self.stored_bytes
        if not stored.packed:
            return chunk
        if not due:
            return b""  # Blosc writes a header even for nothing, and its decoder refuses that
        plain = self._from_blosc(chunk, due) if self.compression & BLOSC else self._from_zip(chunk, due)
        if len(plain) != due:
            raise VolumeError(
                f"{self.source}: damaged chunk of grid {self.name!r} ({len(plain)} bytes, not {due}); export it again"
            )
        return plain

    def _from_zip(self, chunk: bytes, due: int) -> bytes:
        try:
            return zlib.decompressobj().decompress(chunk, due + 1)  # a bomb stops one byte past what is due
        except zlib.error as error:
            raise VolumeError(f"{self.source}: damaged zip chunk ({error}); copy or export the file again") from error

    def _from_blosc(self, chunk: bytes, due: int) -> bytes:
        if len(chunk) < _BLOSC_HEADER.size or _BLOSC_HEADER.unpack_from(chunk)[4::2] != (due, len(chunk)):
            raise VolumeError(f"{self.source}: damaged Blosc chunk of grid {self.name!r}; export the file again")
        try:
            return bytes(_blosc(self.source).decompress(chunk))
        except RuntimeError as error:
            raise VolumeError(f"{self.source}: damaged Blosc chunk ({error}); export the file again") from error


def _blosc(source: str) -> Any:
    try:
        return importlib.import_module("numcodecs.blosc")
    except ImportError as error:
        raise VolumeError(
            f"{source}: compressed with Blosc, which needs numcodecs: pip install numcodecs (or save it with zip)"
        ) from error
