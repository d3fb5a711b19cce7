"""A dense box made of whole leaves, into which the leaves and tiles of a .vdb are put."""

import numpy as np

from sixway.volumes.limits import check_size
from sixway.volumes.listing import Box

LEAF_EDGE = 8
LEAF_VOXELS, LEAF_MASK_BYTES = LEAF_EDGE**3, LEAF_EDGE**3 // 8


def coordinates(places: np.ndarray, log2: int) -> np.ndarray:
    """(x, y, z) [n, 3] of places in a node of 2^log2 children along an edge; z counts fastest."""
    low = (1 << log2) - 1
    return np.stack([places >> 2 * log2, places >> log2 & low, places & low], axis=-1)


def bits_of(mask: bytes) -> np.ndarray:
    """The bits of a node's mask, in order of place."""
    return np.unpackbits(np.frombuffer(mask, np.uint8), bitorder="little")


class LeafBox:
    """Voxels [z, y, x] float32 over a box widened to whole leaves. Origins are (x, y, z) indices of first voxels."""

    def __init__(self, source: str, box: Box, background: float) -> None:
        """Raises VolumeError for a box that is too large."""
        self.low, self.high = np.array(box[0]), np.array(box[1])
        self.start = self.low // LEAF_EDGE * LEAF_EDGE
        x, y, z = ((self.high // LEAF_EDGE - self.low // LEAF_EDGE + 1) * LEAF_EDGE).tolist()
        check_size(source, (z, y, x))
        self.dense = np.zeros((z, y, x), np.float32)
        if background != 0.0:
            self.dense[...] = background
        self.blocks = self.dense.reshape(
            z // LEAF_EDGE, LEAF_EDGE, y // LEAF_EDGE, LEAF_EDGE, x // LEAF_EDGE, LEAF_EDGE
        )

    def overlaps(self, origins: np.ndarray, edge: int) -> np.ndarray:
        """Which [n] of the cubes of that edge at `origins` [n, 3] reach into the box."""
        return np.asarray(((origins + edge > self.low) & (origins <= self.high)).all(axis=1))

    def put_tiles(self, origins: np.ndarray, edge: int, values: np.ndarray) -> None:
        """Fill cubes of that edge, cut to the box, each with its one value [n]."""
        inside = self.overlaps(origins, edge)
        for origin, value in zip((origins[inside] - self.start).tolist(), values[inside], strict=True):
            x, y, z = (slice(max(first, 0), first + edge) for first in origin)
            self.dense[z, y, x] = value

    def put_leaves(self, origins: np.ndarray, voxels: np.ndarray) -> None:
        """Write leaves, voxels [n, 512] with z fastest; those outside the box are dropped."""
        inside = self.overlaps(origins, LEAF_EDGE)
        at = (origins[inside] - self.start) // LEAF_EDGE
        # Index arrays around slices: the result is [leaf, z, y, x]
        self.blocks[at[:, 2], :, at[:, 1], :, at[:, 0], :] = (
            voxels[inside].reshape(-1, LEAF_EDGE, LEAF_EDGE, LEAF_EDGE).transpose(0, 3, 2, 1)
        )

    def cut(self) -> np.ndarray:
        """The box itself, [z, y, x]."""
        first, last = self.low - self.start, self.high - self.start + 1
        return np.ascontiguousarray(self.dense[first[2] : last[2], first[1] : last[1], first[0] : last[0]])
