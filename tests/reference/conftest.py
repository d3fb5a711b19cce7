"""Volumes that the tests of the reference share."""

import numpy as np
import pytest

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame


def blobs(seed: int, n: int = 24) -> DensityFrame:
    """Five smooth blobs in a cube of edge 1 m, no symmetry, densities up to about 1."""
    rng = np.random.default_rng(seed)
    centres = (np.arange(n) + 0.5) / n - 0.5
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij")
    density = np.zeros((n, n, n))
    for _ in range(5):
        cx, cy, cz = rng.uniform(-0.22, 0.22, 3)
        radius2 = rng.uniform(0.08, 0.2) ** 2
        density += np.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / radius2)
    density = np.clip(density - 0.1, 0.0, None)
    return DensityFrame(density=density.astype(np.float32), grid=Grid.centred((n, n, n)))


@pytest.fixture
def blob_frame() -> DensityFrame:
    return blobs(3)


@pytest.fixture
def cube_frame() -> DensityFrame:
    """A homogeneous cube of edge 1 m and density 1."""
    return DensityFrame(density=np.ones((32, 32, 32), np.float32), grid=Grid.centred((32, 32, 32)))
