"""The light grid in NumPy float64: slow, plain, and independent of Warp."""

import numpy as np
from jaxtyping import Float

from sixway.guide.oracle import box_average, henyey_greenstein, sample
from sixway.guide.sweep import LightGrid


def light_cells(density: np.ndarray, size: float, lights: LightGrid) -> Float[np.ndarray, "c b a"]:
    """Density at the centres of the light grid's cells."""
    blur = lights.blur_voxels(size)
    index = np.moveaxis(np.indices(lights.shape[::-1])[::-1], 0, -1)
    centres = lights.corner_m + (index + 0.5) * lights.cell_m @ lights.axes.T
    return sample(box_average(density, blur), centres / (size * blur))


def light_sums(cells: Float[np.ndarray, "c b a"]) -> Float[np.ndarray, "c b a 6"]:
    """Cells added up from every cell's centre to each light."""
    pairs = []
    for axis in (2, 1, 0):
        before = cells.cumsum(axis) - 0.5 * cells
        pairs += [cells.sum(axis, keepdims=True) - before, before]
    return np.stack(pairs, axis=-1)


def lit_blocks(cells: np.ndarray, optical_depth: np.ndarray, edge: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean density of blocks of edge^3 cells, and the density-weighted mean transmittance to each light in them."""
    density = box_average(cells, edge)
    lit = [box_average(cells * np.exp(-optical_depth[..., light]), edge) for light in range(6)]
    return density, np.stack(lit, axis=-1) / np.maximum(density, 1e-30)[..., None]


def ways() -> tuple[np.ndarray, np.ndarray]:
    """The 26 ways from a cell to its neighbours, and the parts of the sphere they stand for (Lebedev 1976)."""
    neighbours = np.array([way for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]) - 1
    return neighbours, np.array([0.0, 1 / 21, 4 / 105, 9 / 280])[np.abs(neighbours).sum(axis=1)]


def turned(cosine: float, g: float) -> float:
    """`sweep.turned` by quadrature."""
    if g == 0.0:
        return 1.0
    neighbours, shares = ways()
    cosines = neighbours[:, 0] / np.linalg.norm(neighbours, axis=1)
    before = shares[cosines > cosine + 1e-6].sum()
    ring = shares[np.abs(cosines - cosine) < 1e-6].sum()
    points = 1.0 - 2.0 * (before + ring * (np.arange(2000) + 0.5) / 2000)  # even in solid angle
    return float(4.0 * np.pi * henyey_greenstein(points, g).mean())


def scatter(
    direct: Float[np.ndarray, "c b a 6"],
    thickness: Float[np.ndarray, "c b a"],
    *,
    albedo: float,
    hg_g: float = 0.0,
    iterations: int,
) -> Float[np.ndarray, "c b a 6"]:
    """`sweep.scatter` by discrete ordinates; thickness: optical depth across each cell."""
    scattered = np.zeros_like(direct)
    for iteration in range(iterations):
        gathered = np.zeros_like(direct)
        for way, share in zip(*ways(), strict=True):
            length = np.linalg.norm(way)
            parts = np.array([turned(sign * axis / length, hg_g) for axis in way for sign in (-1, 1)])
            seen = turned(way[2] / length, hg_g) if iteration == iterations - 1 else 1.0
            half = np.exp(-0.5 * length * thickness)[..., None]
            sent = albedo * share * (direct * parts + scattered) * (1.0 - half)
            steps = way[::-1]  # as the arrays' axes are ordered
            axis = int(np.argmax(steps != 0))
            aside = tuple(np.delete(steps, axis))
            leaving = np.zeros_like(np.moveaxis(sent, axis, 0)[0])
            for n in range(thickness.shape[axis])[:: steps[axis]]:
                half_here, sent_here = (np.moveaxis(field, axis, 0)[n] for field in (half, sent))
                middle = _moved(leaving, aside) * half_here + sent_here
                np.moveaxis(gathered, axis, 0)[n] += seen * middle
                leaving = middle * half_here + sent_here
        scattered = gathered
    return scattered


def _moved(plane: Float[np.ndarray, "n m 6"], by: tuple[int, ...]) -> Float[np.ndarray, "n m 6"]:
    """The plane moved by up to one cell along its axes, with nothing coming in."""
    n, m = plane.shape[:2]
    padded = np.pad(plane, ((1, 1), (1, 1), (0, 0)))
    return padded[1 - by[0] : 1 - by[0] + n, 1 - by[1] : 1 - by[1] + m]


def interpolate_lights(field: Float[np.ndarray, "c b a 6"], cell: np.ndarray) -> np.ndarray:
    """`swept_march_kernels.trilinear_lights` at [..., 3] positions in cells; extrapolated for half a cell."""
    limit = np.array(field.shape[2::-1]) - 2
    low = np.clip(np.floor(cell - 0.5).astype(int), 0, limit)
    part = np.clip(cell - 0.5 - low, -0.5, 1.5)
    total = np.zeros((*cell.shape[:-1], 6))
    for corner in np.ndindex(2, 2, 2):
        share = np.prod(np.where(corner, part, 1.0 - part), axis=-1)
        i, j, k = np.moveaxis(low + corner, -1, 0)
        total += share[..., None] * field[k, j, i]
    return total
