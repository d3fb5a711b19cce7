"""Make configs/sim/meshes/bunny.ply: a sitting rabbit of our own, blended from ellipsoids. Remakes the same bytes.

    python scripts/make_bunny.py [--out FILE]

Axes: x to the side, y up, z where it looks to. The longest edge is its height, 1.
"""

import argparse
from pathlib import Path

import numpy as np
from skimage.measure import marching_cubes

from sixway.core.store import atomic_path

HOME = Path(__file__).parents[1] / "configs" / "sim" / "meshes" / "bunny.ply"
CELLS = 46
"""Samples along its height: some 9,000 triangles."""

# centre, half axes, turn about x [degrees, positive leans forwards]; x > 0 is mirrored to the other side
PARTS = (
    ((0.00, 0.25, -0.12), (0.20, 0.235, 0.245), 0.0),  # rump
    ((0.00, 0.34, 0.06), (0.15, 0.20, 0.15), -20.0),  # chest
    ((0.155, 0.17, -0.08), (0.095, 0.165, 0.175), 0.0),  # thighs
    ((0.165, 0.045, 0.04), (0.060, 0.046, 0.185), 0.0),  # hind feet
    ((0.070, 0.15, 0.175), (0.046, 0.17, 0.050), 6.0),  # forelegs
    ((0.070, 0.036, 0.215), (0.050, 0.038, 0.075), 0.0),  # paws
    ((0.00, 0.585, 0.19), (0.125, 0.120, 0.140), 12.0),  # head
    ((0.00, 0.545, 0.315), (0.065, 0.058, 0.060), 0.0),  # muzzle
    ((0.065, 0.530, 0.24), (0.070, 0.068, 0.075), 0.0),  # cheeks
    ((0.00, 0.17, -0.375), (0.080, 0.080, 0.075), 0.0),  # tail
)
EARS = ((0.078, 0.82, 0.10), (0.056, 0.205, 0.040), -14.0)
"""Blended less than the rest, so that they stand apart."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HOME)
    out = parser.parse_args().out
    vertices, triangles = bunny()
    with atomic_path(out) as temporary:
        temporary.write_bytes(ply(vertices, triangles))
    print(f"{out}: {len(vertices)} vertices, {len(triangles)} triangles, {out.stat().st_size} bytes")


def bunny() -> tuple[np.ndarray, np.ndarray]:
    """Vertices [v, 3] and triangles [f, 3], closed, counter-clockwise seen from outside."""
    low, high = np.array([-0.36, -0.06, -0.54]), np.array([0.36, 1.08, 0.48])
    counts = np.ceil((high - low) * CELLS).astype(int) + 1
    axes = [low[n] + np.arange(counts[n]) / CELLS for n in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points[..., 0] = np.abs(points[..., 0])
    distance = smooth_union([ellipsoid(points, *part) for part in PARTS], 0.016)
    distance = smooth_union([distance, ellipsoid(points, *EARS)], 0.012)
    vertices, triangles, _, _ = marching_cubes(distance, 0.0, spacing=(1.0 / CELLS,) * 3)
    vertices = vertices + low
    height = np.ptp(vertices[:, 1])
    return (vertices - [0.0, vertices[:, 1].min(), 0.0]) / height, triangles


def ellipsoid(points: np.ndarray, centre: tuple, half: tuple, lean_deg: float) -> np.ndarray:
    """Near its surface the distance to an ellipsoid, k0 (k0 - 1) / k1 with k0 = |p / r|, k1 = |p / r^2|."""
    angle = np.deg2rad(lean_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(points - centre, -1, 0)
    p = np.stack([x, cos * y + sin * z, cos * z - sin * y], axis=-1)
    k0 = np.linalg.norm(p / half, axis=-1)
    k1 = np.linalg.norm(p / np.square(half), axis=-1)
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)


def smooth_union(distances: list[np.ndarray], width: float) -> np.ndarray:
    """-width log sum exp(-d / width): a union whose seams are filled."""
    return -width * np.logaddexp.reduce([-d / width for d in distances])


def ply(vertices: np.ndarray, triangles: np.ndarray) -> bytes:
    """A binary little-endian .ply."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment a rabbit by scripts/make_bunny.py\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, triangles
    return header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes()


if __name__ == "__main__":
    main()
