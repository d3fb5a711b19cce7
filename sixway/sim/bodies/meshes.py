"""Triangle meshes from .obj, .stl and .ply files: read with suspicion, and their exact distance in NumPy."""

import io
import os
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

SUFFIXES = (".obj", ".stl", ".ply")
_LARGEST_FILE_BYTES = 64 << 20
_MOST_FACES = 500_000
_PAIRS_AT_ONCE = 1 << 18
"""Points times faces held in memory at once: some 100 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A triangle mesh, moved and scaled so that its bounds are centred on 0 and their longest edge is 1.

    vertices: [v, 3] float64. faces: [f, 3] corners, counter-clockwise seen from outside. path: where it came from.
    centre, edge: middle and longest edge of its bounds in that file.
    """

    path: Path
    centre: Float[np.ndarray, "3"]
    edge: float
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]

    @cached_property
    def hull(self) -> Float[np.ndarray, "h 3"]:
        """The corners of its convex hull: few vertices with the same bounds, however they turn."""
        return self.vertices[ConvexHull(self.vertices, qhull_options="Qt Pp").vertices]

    @property
    def half_extent(self) -> Float[np.ndarray, "3"]:
        """Half the edges of its bounds; the longest is 0.5."""
        return self.vertices[self.faces].max(axis=(0, 1))

    @property
    def open_edges(self) -> int:
        """Edges with a triangle on one side only: 0 if the mesh is watertight."""
        return int(np.count_nonzero(self._imbalance() % 2))

    @property
    def flipped_edges(self) -> int:
        """Edges whose two triangles disagree about what is outside: 0 if the mesh is oriented."""
        imbalance = self._imbalance()
        return int(np.count_nonzero((imbalance > 0) & (imbalance % 2 == 0)))

    def signed_distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Exact distance to the triangles, negative where the winding number exceeds 1/2, float64.

        Every point against every triangle: for checks and tests, not for grids.
        """
        corners = self.vertices[self.faces]
        distance = np.empty(len(points))
        step = max(1, _PAIRS_AT_ONCE // len(corners))
        for first in range(0, len(points), step):
            some = points[first : first + step]
            sign = np.where(winding_number(some, corners) > 0.5, -1.0, 1.0)
            distance[first : first + step] = sign * distance_to_triangles(some, corners)
        return distance

    def _imbalance(self) -> Int[np.ndarray, "e"]:
        """How much more often each edge is walked one way than the other."""
        start, end = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        edge = np.minimum(start, end).astype(np.int64) * len(self.vertices) + np.maximum(start, end)
        _, number = np.unique(edge, return_inverse=True)
        return np.abs(np.bincount(number, np.where(start < end, 1, -1))).astype(np.int64)


def read_surface(path: Path) -> Surface:
    """Read the geometry of a mesh file and nothing else: materials and textures are neither opened nor followed.

    Raises ValueError, naming the file, for another suffix, no or an unreadable file, more than 64 MB or half a million
    triangles, none at all, vertices that are no finite numbers, and a mesh that is flat.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: a mesh file ends in one of {', '.join(SUFFIXES)}; convert it")
    if not path.is_file():
        raise ValueError(f"{path}: there is no such mesh file; paths count from the folder of the config file")
    status = path.stat()
    if not 0 < status.st_size <= _LARGEST_FILE_BYTES:
        raise ValueError(
            f"{path}: has {status.st_size} bytes, and a mesh file has 1 to {_LARGEST_FILE_BYTES}; "
            "decimate it or export it again"
        )
    return _read(os.fspath(path.resolve()), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)
def _read(name: str, modified_ns: int, size: int) -> Surface:
    path = Path(name)
    vertices, faces = _parse(path)
    if len(faces) == 0:
        raise ValueError(f"{path}: holds no triangles; export the mesh with its faces")
    if len(faces) > _MOST_FACES:
        raise ValueError(f"{path}: has {len(faces)} triangles, more than {_MOST_FACES}; decimate it")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"{path}: a triangle names a vertex that is not there; export it again")
    used, faces = np.unique(faces, return_inverse=True)  # lone vertices must not count in the bounds
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    if not (np.isfinite(vertices).all() and np.abs(vertices).max() < 1e30):
        raise ValueError(f"{path}: has vertices that are no finite numbers below 1e30; export it again")
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    longest = float((high - low).max())
    if not (high - low).min() > 1e-6 * longest:
        raise ValueError(f"{path}: is flat, with bounds of {(high - low).tolist()}; a solid has a thickness")
    vertices, merged = np.unique((vertices - 0.5 * (low + high)) / longest, axis=0, return_inverse=True)
    faces = merged.reshape(-1)[faces].astype(np.int32)  # .stl repeats each vertex in every triangle
    if _volume(vertices[faces]) < 0.0:
        faces = faces[:, ::-1].copy()  # inside out
    return Surface(path=path, centre=0.5 * (low + high), edge=longest, vertices=vertices, faces=faces)


def _parse(path: Path) -> tuple[np.ndarray, np.ndarray]:
    import trimesh  # a third of a second, which only scenes with meshes pay

    try:
        mesh = trimesh.load_mesh(
            io.BytesIO(path.read_bytes()),  # a stream without a name: there is no folder to look for materials in
            file_type=path.suffix.lower()[1:],
            process=False,
            skip_materials=True,
        )
        return np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64).reshape(-1, 3)
    except Exception as error:  # whatever a parser meets in a broken file
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(
            f"{path}: is no readable {path.suffix.lower()} mesh ({reason[:200]}); export it again"
        ) from error


def _volume(corners: Float[np.ndarray, "f 3 3"]) -> float:
    """Signed volume, positive if triangles are counter-clockwise seen from outside."""
    return float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0


def winding_number(points: Float[np.ndarray, "n 3"], corners: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "n"]:
    """Share of the sphere around each point that the triangles cover: 1 inside a closed mesh, 0 outside.

    Jacobson et al. 2013, Eq. 5, with the solid angle of Van Oosterom and Strackee 1983.
    """
    a, b, c = np.moveaxis(corners[None] - points[:, None, None, :], 2, 0)
    length_a, length_b, length_c = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    triple = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("nfi,nfi->nf", u, v) for u, v in ((a, b), (b, c), (c, a)))
    below = length_a * length_b * length_c + ab * length_c + bc * length_a + ca * length_b
    return np.arctan2(triple, below).sum(axis=1) / (2.0 * np.pi)


def distance_to_triangles(
    points: Float[np.ndarray, "n 3"], corners: Float[np.ndarray, "f 3 3"]
) -> Float[np.ndarray, "n"]:
    """Distance to the nearest triangle: to its face where the point stands above it, else to its edges."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=-1)
    normal = normal / np.maximum(length, 1e-300)[:, None]
    above = np.broadcast_to(length > 0.0, (len(points), len(corners)))  # a sliver is its edges
    squared = np.full(above.shape, np.inf)
    for n in range(3):
        start, edge = corners[:, n], corners[:, (n + 1) % 3] - corners[:, n]
        offset = points[:, None] - start
        along = np.einsum("nfi,fi->nf", offset, edge) / np.maximum(np.sum(edge**2, axis=-1), 1e-300)
        apart = offset - np.clip(along, 0.0, 1.0)[..., None] * edge
        squared = np.minimum(squared, np.einsum("nfi,nfi->nf", apart, apart))
        above = above & (np.einsum("nfi,fi->nf", offset, np.cross(normal, edge)) >= 0.0)
    height = np.einsum("nfi,fi->nf", points[:, None] - corners[:, 0], normal)
    return np.sqrt(np.where(above, np.minimum(squared, height**2), squared).min(axis=1))
