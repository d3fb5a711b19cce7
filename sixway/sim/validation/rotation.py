"""One turn of a sharp density in a rotating flow: what advection keeps of it."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from sixway.sim.carried.scalars import Scalars, Scheme

SCHEMES: tuple[Scheme, ...] = ("cubic", "linear")


@dataclass(frozen=True, kw_only=True)
class Kept:
    """What one turn leaves of a sharp density, as parts of what there was.

    l1_error: sum of |after - before|. mass, energy (sum of squares), gradient_energy (sum of squared differences).
    least, most: of the values after; before they are 0 and 1.
    """

    scheme: Scheme
    l1_error: float
    mass: float
    energy: float
    gradient_energy: float
    least: float
    most: float


def rotation_table(
    *, voxels: int = 64, steps: int = 100, device: str = "cpu", threads: int = 1, schemes: tuple[Scheme, ...] = SCHEMES
) -> list[Kept]:
    """A slotted ball with ripples (Zalesak 1979, in 3-D) turned once about z in `steps` advections, by each scheme.

    Its edges are one voxel wide, the ripples eight voxels long: far harder than smoke.
    """
    before = slotted_ball(voxels)
    wind = wp.array(rigid_rotation(voxels // 2, steps), dtype=wp.vec3, device=device)
    rows = []
    for scheme in schemes:
        cells = (voxels // 2,) * 3
        scalars = Scalars(("density",), shape_zyx=cells, refinement=2, scheme=scheme, device=device, threads=threads)
        scalars.fields["density"].assign(before)
        for _ in range(steps):
            scalars.advect(wind, steps=1.0)
        after = scalars.fields["density"].numpy().astype(np.float64)
        rows.append(
            Kept(
                scheme=scheme,
                l1_error=float(np.abs(after - before).sum() / before.sum()),
                mass=float(after.sum() / before.sum()),
                energy=float((after**2).sum() / (before.astype(np.float64) ** 2).sum()),
                gradient_energy=gradient_energy(after) / gradient_energy(before),
                least=float(after.min()),
                most=float(after.max()),
            )
        )
    return rows


def slotted_ball(voxels: int) -> np.ndarray:
    """Density in [0, 1], float32 [z, y, x]."""
    z, y, x = np.indices((voxels,) * 3) - 0.5 * (voxels - 1)
    inside = (x - 0.2 * voxels) ** 2 + y**2 + z**2 < (0.15 * voxels) ** 2
    slot = (np.abs(y) < 0.03 * voxels) & (x < 0.25 * voxels)
    ripples = 0.5 + 0.5 * np.sign(np.sin(2.0 * np.pi * z / 8.0))
    return (inside & ~slot).astype(np.float32) * (0.25 + 0.75 * ripples).astype(np.float32)


def rigid_rotation(cells: int, steps: int) -> np.ndarray:
    """Velocity [cells/step] that turns the box once about z in `steps`, [z, y, x, 3] with its shell."""
    _, y, x = np.indices((cells + 2,) * 3) - 0.5 * (cells + 1)
    return 2.0 * np.pi / steps * np.stack([-y, x, np.zeros_like(x)], axis=-1)


def gradient_energy(values: np.ndarray) -> float:
    return float(sum((np.diff(values, axis=axis).astype(np.float64) ** 2).sum() for axis in range(3)))
