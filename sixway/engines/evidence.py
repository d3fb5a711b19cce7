"""What six-way maps of real smoke have in common, measured on pictures and compared with bakes.

Light from a side is brightest on that side of the smoke: a map's share of the sum of all maps grows towards
its light. Light from the viewer's side is brightest where the smoke is thick, light from behind at its rims.
Premultiplied maps fade with alpha where the smoke is thin (the sum of the maps grows as alpha to the power 1;
a wrong curve gives another power), and conservation of energy ties their size to it: six maps of white,
multiply scattering smoke sum to 1.5 alpha.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

Maps = Float[np.ndarray, "n h w c"]
Plane = Float[np.ndarray, "n h w"]

_NOISE = 1e-4


@dataclass(frozen=True)
class Normal:
    """Mean and standard deviation of one measurement over healthy bakes."""

    mean: float
    deviation: float

    def log_odds(self, value: float) -> float:
        """Log density up to a constant, with the tails of a Student t: one odd value must not decide alone."""
        z = (value - self.mean) / self.deviation
        return -2.5 * float(np.log1p(z * z / 4.0)) - float(np.log(self.deviation))


def layout(maps: Maps) -> Float[np.ndarray, "c 7"]:
    """For each map where its share of the sum is high.

    Columns: Fisher z of the correlation, weighted with the sum of the maps, between the share and (0) x, (1) y,
    (2, 3) the outward normal of the blurred sum in x and y, (4) the sum itself, (5) the steepness of its rim;
    (6) the log of the map's part of all light, 0 for an even part. +x is right, +y is up.
    """
    _, height, width, _ = maps.shape
    total = maps.sum(-1)
    brightest = max(float(total.max()), _NOISE)
    x = np.broadcast_to(np.linspace(-1.0, 1.0, width), total.shape)
    y = np.broadcast_to(np.linspace(1.0, -1.0, height)[:, None], total.shape)
    blurred = gaussian_filter(total / brightest, (0.0, 0.045 * height, 0.045 * width))
    down, right = np.gradient(blurred, axis=(1, 2))
    steep = np.hypot(down, right)
    steep = steep + 1e-3 * max(float(steep.max()), _NOISE)
    thick = gaussian_filter(total / brightest, (0.0, 1.0, 1.0))
    lit = total > 1e-3 * brightest  # the rest has next to no weight
    if not lit.any():
        return np.zeros((maps.shape[-1], 7))
    weight = total[lit] / total[lit].sum()
    share = maps[lit] / (total[lit] + 1e-4 * brightest)[:, None]
    against = np.stack([field[lit] for field in (x, y, -right / steep, down / steep, thick, steep)], axis=-1)
    part = np.log(np.maximum(maps.sum((0, 1, 2)), _NOISE) / float(total.sum()) * maps.shape[-1])
    return np.column_stack([_fisher(share, against, weight), part])


def _fisher(
    a: Float[np.ndarray, "p c"], b: Float[np.ndarray, "p k"], weight: Float[np.ndarray, "p"]
) -> Float[np.ndarray, "c k"]:
    """Fisher z of the weighted correlation of every column of `a` with every column of `b`."""
    a, b = a - weight @ a, b - weight @ b
    spread = np.sqrt(np.outer(weight @ (a * a), weight @ (b * b)))
    product = (a * weight[:, None]).T @ b
    return np.arctanh(np.clip(np.where(spread > 1e-9, product / np.maximum(spread, 1e-9), 0.0), -0.99, 0.99))


def tone(maps: Maps, alpha: Plane) -> Float[np.ndarray, "4"]:
    """How premultiplied maps go with alpha.

    (0) power with which the sum of the maps grows with alpha where alpha is 0.02 to 0.5, (1) where it is 0.3 to
    0.97, (2) log of the sum of six average maps over alpha, (3) correlation of the two logs, Fisher z.
    """
    total = 6.0 * maps.mean(-1)
    low, _ = _power(total, alpha, 0.02, 0.5)
    middle, _ = _power(total, alpha, 0.3, 0.97)
    _, agreement = _power(total, alpha, 0.02, 1.1)
    size = np.log(max(float(total.sum()), _NOISE) / max(float(alpha.sum()), _NOISE))
    return np.array([low, middle, size, agreement])


def _power(total: Plane, alpha: Plane, least: float, most: float) -> tuple[float, float]:
    """Slope and Fisher z of log total against log alpha."""
    inside = (alpha > least) & (alpha < most)
    if np.count_nonzero(inside) < 24:
        return np.nan, np.nan
    x, y = np.log(alpha[inside]), np.log(np.maximum(total[inside], _NOISE))
    x, y = x - x.mean(), y - y.mean()
    spread = float((x * x).mean())
    if spread < 1e-6:
        return np.nan, np.nan
    slope = float((x * y).mean()) / spread
    deviation = np.sqrt(spread * float((y * y).mean()))
    return slope, float(np.arctanh(np.clip(slope * spread / max(deviation, 1e-9), -0.99, 0.99)))


def rim(maps: Maps) -> float:
    """Light on the outermost pixels of each tile against its mean, in [0, 1]: near 0 for premultiplied maps."""
    total = maps.sum(-1)
    ring = np.concatenate([total[:, 0], total[:, -1], total[:, :, 0], total[:, :, -1]], axis=1)
    return float(min(ring.mean() / max(float(total.mean()), _NOISE), 1.0))


def size(maps: Maps) -> float:
    """Log of the brightest map values (99.5th percentile)."""
    return float(np.log(max(float(np.percentile(maps, 99.5)), _NOISE)))
