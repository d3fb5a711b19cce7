"""The 5-4-3 tree of an OpenVDB grid: root, nodes of 32^3 and 16^3 children, leaves of 8^3 voxels.

After `openvdb/tree/{RootNode,InternalNode,LeafNode}.h`. First the topology is walked, which tells the box; only
then memory for the box is given and values are decoded. Places in a node count z fastest; nodes lie z, y, x
in our arrays.
"""

from dataclasses import dataclass, field

import numpy as np

from sixway.volumes.leaves import LEAF_EDGE, LEAF_MASK_BYTES, LEAF_VOXELS, LeafBox, bits_of, coordinates
from sixway.volumes.limits import VolumeError
from sixway.volumes.listing import Box
from sixway.volumes.vdb_format import Cursor, Descriptor
from sixway.volumes.vdb_values import Stored, ValueFormat

LOWER_EDGE, UPPER_EDGE = 128, 4096  # of inner nodes, in voxels
UPPER_LOG2, LOWER_LOG2 = 5, 4  # children along an edge
_LEAVES_AT_ONCE = 4096


@dataclass(frozen=True)
class _Node:
    """An inner node. tile_edge: voxels along an edge of one of its places. *_mask: bytes, one bit a place."""

    origin: np.ndarray
    log2: int
    tile_edge: int
    child_mask: bytes
    value_mask: bytes
    stored: Stored

    def places(self, bits: np.ndarray) -> np.ndarray:
        """First voxels [n, 3] of the places whose bit is set."""
        return self.origin + self.tile_edge * coordinates(np.flatnonzero(bits), self.log2)


@dataclass
class Tree:
    """A grid's topology. leaf_origins: [n, 3] first voxel of each leaf; leaf_masks: [n, 64] its active bits."""

    values: ValueFormat
    nodes: list[_Node] = field(default_factory=list)
    root_tiles: list[tuple[np.ndarray, float, bool]] = field(default_factory=list)
    leaf_origins: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    leaf_masks: np.ndarray = field(default_factory=lambda: np.zeros((0, LEAF_MASK_BYTES), np.uint8))


def read_topology(source: str, data: bytes, grid: Descriptor) -> Tree:
    """Walk a tree without decoding a value. Raises VolumeError for damage."""
    cursor = Cursor(source, data, grid.tree_at)
    cursor.skip(4)  # number of buffers a leaf, always 1
    tree = Tree(ValueFormat(source, grid, cursor))
    num_tiles, num_children = cursor.unpack("2I")
    for _ in range(num_tiles):
        origin = np.array(cursor.unpack("3i"))
        tree.root_tiles.append((origin, tree.values.tile(cursor), bool(cursor.number("B"))))
    origins, masks = [tree.leaf_origins], [tree.leaf_masks]
    seen = set()
    for _ in range(num_children):
        origin = np.array(cursor.unpack("3i"))
        if (origin % UPPER_EDGE).any() or tuple(origin) in seen:
            raise VolumeError(f"{source}: damaged tree of grid {grid.name!r}; copy or export the file again")
        seen.add(tuple(origin))
        upper = _read_node(cursor, tree, origin, UPPER_LOG2, LOWER_EDGE)
        for first in upper.places(bits_of(upper.child_mask)):
            lower = _read_node(cursor, tree, first, LOWER_LOG2, LEAF_EDGE)
            leaves = lower.places(bits_of(lower.child_mask))
            raw = cursor.take(len(leaves) * LEAF_MASK_BYTES)
            origins.append(leaves)
            masks.append(np.frombuffer(raw, np.uint8).reshape(-1, LEAF_MASK_BYTES))
    tree.leaf_origins, tree.leaf_masks = np.concatenate(origins), np.concatenate(masks)
    return tree


def _read_node(cursor: Cursor, tree: Tree, origin: np.ndarray, log2: int, tile_edge: int) -> _Node:
    size = 1 << 3 * log2
    child_mask, value_mask = cursor.take(size // 8), cursor.take(size // 8)
    active = int.from_bytes(value_mask, "little").bit_count()
    node = _Node(origin, log2, tile_edge, child_mask, value_mask, tree.values.locate(cursor, active, size))
    tree.nodes.append(node)
    return node


def active_box(tree: Tree) -> Box | None:
    """First and last (x, y, z) of the active voxels and tiles, inclusive; None if nothing is active."""
    lows, highs = [], []
    on = tree.leaf_masks.reshape(-1, LEAF_EDGE, LEAF_EDGE)  # a byte holds the eight voxels along z
    filled = on.any(axis=(1, 2))
    on, origins = on[filled], tree.leaf_origins[filled]
    if len(on):
        along_z = np.unpackbits(np.bitwise_or.reduce(on, axis=(1, 2), keepdims=True)[:, 0], axis=1, bitorder="little")
        along = [np.asarray(bits) for bits in (on.any(axis=2), on.any(axis=1), along_z)]
        first = np.stack([a.argmax(axis=1) for a in along], axis=1)
        last = LEAF_EDGE - 1 - np.stack([a[:, ::-1].argmax(axis=1) for a in along], axis=1)
        lows.append((origins + first).min(axis=0))
        highs.append((origins + last).max(axis=0))
    for node in tree.nodes:
        if any(node.value_mask):
            tiles = node.places(bits_of(node.value_mask) & ~bits_of(node.child_mask) & 1)
            if len(tiles):
                lows.append(tiles.min(axis=0))
                highs.append(tiles.max(axis=0) + node.tile_edge - 1)
    for origin, _, active in tree.root_tiles:
        if active:
            lows.append(origin)
            highs.append(origin + UPPER_EDGE - 1)
    if not lows:
        return None
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    return (int(low[0]), int(low[1]), int(low[2])), (int(high[0]), int(high[1]), int(high[2]))


def read_dense(source: str, data: bytes, tree: Tree, blocks_at: int, box: Box) -> np.ndarray:
    """The box as float32 [z, y, x], active or not, as OpenVDB's copyToArray has it. Raises VolumeError."""
    dense = LeafBox(source, box, tree.values.background)
    for origin, value, _ in tree.root_tiles:
        dense.put_tiles(origin[None], UPPER_EDGE, np.array([value]))
    for node in tree.nodes:
        values = _node_values(data, tree.values, node.stored, node.value_mask)
        differs = (bits_of(node.child_mask) == 0) & (values != np.float32(tree.values.background))
        dense.put_tiles(node.places(differs), node.tile_edge, values[differs])
    _fill_leaves(source, data, tree, blocks_at, dense)
    return dense.cut()


def _node_values(data: bytes, values: ValueFormat, stored: Stored, mask: bytes) -> np.ndarray:
    flat = np.frombuffer(values.unpack(data, stored), values.stored_type)
    held = None if stored.all_stored else bits_of(mask)[None]
    return _restore(data, values, [stored], flat, held, size=len(mask) * 8)[0]


def _restore(
    data: bytes, values: ValueFormat, nodes: list[Stored], flat: np.ndarray, held: np.ndarray | None, *, size: int
) -> np.ndarray:
    """All values [n, size] of nodes: those stored, in order of place, and the inactive ones between them."""
    with np.errstate(over="ignore", invalid="ignore"):  # what does not fit a float is found by the check of the density
        if held is None:
            return flat.astype(np.float32).reshape(len(nodes), size)
        full = np.empty((len(nodes), size), np.float32)
        full[:] = np.array([node.inactive[0] for node in nodes])[:, None]
        for row, node in enumerate(nodes):
            if node.selection_at >= 0:
                second = bits_of(data[node.selection_at : node.selection_at + size // 8]) == 1
                full[row, second] = node.inactive[1]
        full[held == 1] = flat
        return full


def _fill_leaves(source: str, data: bytes, tree: Tree, blocks_at: int, dense: LeafBox) -> None:
    """Decode the leaf buffers, a few thousand leaves at a time, into the dense box."""
    cursor = Cursor(source, data, blocks_at)
    for begin in range(0, len(tree.leaf_origins), _LEAVES_AT_ONCE):
        masks = tree.leaf_masks[begin : begin + _LEAVES_AT_ONCE]
        nodes, chunks = [], []
        for mask, active in zip(masks, np.bitwise_count(masks).sum(axis=1).tolist(), strict=True):
            if cursor.take(LEAF_MASK_BYTES) != mask.tobytes():
                raise VolumeError(f"{source}: leaves of grid {tree.values.name!r} are damaged; export the file again")
            nodes.append(tree.values.locate(cursor, active, LEAF_VOXELS))
            chunks.append(tree.values.unpack(data, nodes[-1]))
        held = np.unpackbits(masks, axis=1, bitorder="little")
        held[[node.all_stored for node in nodes]] = 1
        flat = np.frombuffer(b"".join(chunks), tree.values.stored_type)
        voxels = _restore(data, tree.values, nodes, flat, held, size=LEAF_VOXELS)
        dense.put_leaves(tree.leaf_origins[begin : begin + _LEAVES_AT_ONCE], voxels)
