"""Writing OpenVDB files (.vdb): one float fog grid ``density``, so that a frame opens in Houdini or Blender.

File version 224, tree 5-4-3, active values only, zip. `vdb_format`, `vdb_values` and `vdb_tree` tell the layout.
"""

import hashlib
import struct
import uuid
import zlib
from pathlib import Path

import numpy as np

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.core.store import atomic_path
from sixway.volumes.leaves import LEAF_EDGE
from sixway.volumes.vdb_format import ACTIVE_MASK, MAGIC, VERSION, ZIP
from sixway.volumes.vdb_tree import LOWER_EDGE, LOWER_LOG2, UPPER_EDGE, UPPER_LOG2

_LIBRARY = (10, 0)  # the OpenVDB whose files these are like
_NOTHING_STORED = b"\0" + struct.pack("<q", 0)  # all inactive values are background; a chunk of no bytes


def write_vdb(path: Path, frame: DensityFrame) -> None:
    """Write the density of a frame atomically; all else is left out.

    Voxel (0, 0, 0) is the frame's first one. Active are voxels with density and the two at the far corners
    of the box, so that the active box is the frame's box in every frame of a sequence.
    """
    origins, voxels, active = _leaves(frame.density)
    topology, order = _topology(origins, active)
    name, tree_type = _text("density"), _text("Tree_float_5_4_3")
    head = _header(frame) + name + tree_type + _text("")
    grid_at = len(head) + 3 * 8
    grid = struct.pack("<I", ZIP | ACTIVE_MASK) + _metadata(frame, int(active.sum())) + _transform(frame.grid)
    blocks_at = grid_at + len(grid) + len(topology)
    buffers = b"".join(_leaf(voxels[i], active[i]) for i in order)
    offsets = struct.pack("<3q", grid_at, blocks_at, blocks_at + len(buffers))
    with atomic_path(path) as temporary:
        temporary.write_bytes(head + offsets + grid + topology + buffers)


def _leaves(density: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins [n, 3], voxels [n, 512] and active bits [n, 512] of the leaves that hold an active voxel."""
    padded = np.pad(density, [(0, -edge % LEAF_EDGE) for edge in density.shape])
    z, y, x = (edge // LEAF_EDGE for edge in padded.shape)
    blocks = padded.reshape(z, LEAF_EDGE, y, LEAF_EDGE, x, LEAF_EDGE)
    filled = (blocks != 0.0).any(axis=(1, 3, 5))
    filled[0, 0, 0] = filled[-1, -1, -1] = True
    at = np.argwhere(filled)
    voxels = blocks[at[:, 0], :, at[:, 1], :, at[:, 2], :].transpose(0, 3, 2, 1).reshape(len(at), -1)
    active = voxels != 0.0
    active[0, 0] = True
    far_z, far_y, far_x = ((edge - 1) % LEAF_EDGE for edge in density.shape)
    active[-1, (far_x * LEAF_EDGE + far_y) * LEAF_EDGE + far_z] = True
    return at[:, ::-1] * LEAF_EDGE, voxels, active


def _topology(origins: np.ndarray, active: np.ndarray) -> tuple[bytes, list[int]]:
    """The tree but for its leaf buffers, and the order of the leaves in it."""
    keys = [
        _place(origins % UPPER_EDGE // LOWER_EDGE, UPPER_LOG2),
        _place(origins % LOWER_EDGE // LEAF_EDGE, LOWER_LOG2),
    ]
    root = origins // UPPER_EDGE
    order = np.lexsort((keys[1], keys[0], root[:, 2], root[:, 1], root[:, 0])).tolist()
    tree: dict[tuple[int, ...], dict[int, list[int]]] = {}
    for leaf in order:
        tree.setdefault(tuple(root[leaf].tolist()), {}).setdefault(int(keys[0][leaf]), []).append(leaf)
    masks = np.packbits(active, axis=1, bitorder="little")
    parts = [struct.pack("<ifII", 1, 0.0, 0, len(tree))]  # buffers a leaf, background, root's tiles and children
    for corner, lowers in tree.items():
        parts += [struct.pack("<3i", *(UPPER_EDGE * c for c in corner)), _node(list(lowers), UPPER_LOG2)]
        for leaves in lowers.values():
            parts += [_node(keys[1][leaves], LOWER_LOG2), masks[leaves].tobytes()]
    return b"".join(parts), order


def _place(coordinates: np.ndarray, log2: int) -> np.ndarray:
    x, y, z = coordinates.T
    return (x << 2 * log2) + (y << log2) + z


def _node(children: list[int] | np.ndarray, log2: int) -> bytes:
    """An inner node without tiles: child mask, value mask, no values."""
    bits = np.zeros(1 << 3 * log2, np.uint8)
    bits[children] = 1
    return np.packbits(bits, bitorder="little").tobytes() + bytes(len(bits) // 8) + _NOTHING_STORED


def _leaf(voxels: np.ndarray, active: np.ndarray) -> bytes:
    plain = voxels[active].astype("<f4").tobytes()
    packed = zlib.compress(plain)
    mask = np.packbits(active, bitorder="little").tobytes()
    if len(packed) < len(plain):
        return mask + b"\0" + struct.pack("<q", len(packed)) + packed
    return mask + b"\0" + struct.pack("<q", -len(plain)) + plain


def _text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode("ascii")


def _header(frame: DensityFrame) -> bytes:
    """Up to the number of grids. The UUID follows from the content: equal frames give equal files."""
    digest = hashlib.sha256(repr(frame.grid).encode() + np.ascontiguousarray(frame.density).tobytes()).digest()
    identity = str(uuid.UUID(bytes=digest[:16], version=4)).encode("ascii")
    no_metadata, one_grid = struct.pack("<I", 0), struct.pack("<i", 1)
    return MAGIC + struct.pack("<IIIB", VERSION, *_LIBRARY, 1) + identity + no_metadata + one_grid


def _metadata(frame: DensityFrame, num_active: int) -> bytes:
    """What OpenVDB writes beside every grid: class, name, and the box for tools that only list."""
    z, y, x = frame.density.shape
    entries = (
        ("class", "string", b"fog volume"),
        ("file_bbox_max", "vec3i", struct.pack("<3i", x - 1, y - 1, z - 1)),
        ("file_bbox_min", "vec3i", struct.pack("<3i", 0, 0, 0)),
        ("file_compression", "string", b"zip + active values"),
        ("file_voxel_count", "int64", struct.pack("<q", num_active)),
        ("is_saved_as_half_float", "bool", b"\0"),
        ("name", "string", b"density"),
    )
    parts = [_text(name) + _text(kind) + struct.pack("<I", len(value)) + value for name, kind, value in entries]
    return struct.pack("<I", len(entries)) + b"".join(parts)


def _transform(grid: Grid) -> bytes:
    """Translation to the centre of voxel 0, then the scale and what OpenVDB keeps beside it."""
    edge = grid.voxel_size_m
    rows = [[o + 0.5 * edge for o in grid.origin_m]]
    rows += [[value] * 3 for value in (edge, edge, 1.0 / edge, 1.0 / edge**2, 0.5 / edge)]
    return _text("UniformScaleTranslateMap") + struct.pack("<18d", *(v for row in rows for v in row))
