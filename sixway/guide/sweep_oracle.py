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


def turns(g: float) -> tuple[float, float, float]:
    """`sweep.turns` by quadrature."""
    cosine = (np.arange(30000) + 0.5) / 15000 - 1.0
    phase = henyey_greenstein(cosine, g) / henyey_greenstein(cosine, g).sum()
    onwards, back = phase[cosine > 2 / 3].sum(), phase[cosine < -2 / 3].sum()
    return onwards, 0.25 * (1.0 - onwards - back), back


def scatter(
    thickness: Float[np.ndarray, "c b a"], *, albedo: float, hg_g: float = 0.0, iterations: int
) -> Float[np.ndarray, "c b a 6"]:
    """`sweep.scatter` by discrete ordinates; thickness: optical depth across each cell."""
    direct = np.exp(-light_sums(thickness))
    scattered = np.zeros_like(direct)
    onwards, aside, back = turns(hg_g)
    for iteration in range(iterations):
        gathered = np.zeros_like(direct)
        for axis in range(3):
            for down in (False, True):
                light_down, light_up = 2 * (2 - axis), 2 * (2 - axis) + 1
                turned = np.full(6, aside)
                turned[light_down], turned[light_up] = (onwards, back) if down else (back, onwards)
                seen = 1.0
                if iteration == iterations - 1:
                    seen = 6.0 * (aside if axis > 0 else back if down else onwards)
                way = slice(None, None, -1 if down else 1)
                half = np.exp(-0.5 * np.moveaxis(thickness, axis, 0)[way])[..., None]
                source = albedo * np.moveaxis(direct * turned + scattered / 6.0, axis, 0)[way]
                middle = np.zeros_like(source)
                arriving = np.zeros_like(source[0])
                for n in range(len(source)):
                    middle[n] = arriving * half[n] + source[n] * (1.0 - half[n])
                    arriving = middle[n] * half[n] + source[n] * (1.0 - half[n])
                gathered += seen * np.moveaxis(middle[way], 0, axis)
        scattered = gathered
    return scattered


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
