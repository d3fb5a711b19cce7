"""Seeded gusts: what makes two plumes of one scenario differ."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float

wp.set_module_options({"enable_backward": False})

GUST_MODES = 24


@dataclass(frozen=True, kw_only=True)
class Gusts:
    """Random Fourier modes u'(x, t) = sum_a amplitude_a cos(wave_a . x + frequency_a t + phase_a).

    Each amplitude stands across its wave, so the gusts neither compress nor stretch the air
    (Kraichnan 1970, "Diffusion by a random velocity field"). Lattice units; x counts cells.
    """

    wave: Float[np.ndarray, "a 3"]
    amplitude: Float[np.ndarray, "a 3"]
    frequency: Float[np.ndarray, "a"]
    phase: Float[np.ndarray, "a"]

    @classmethod
    def draw(cls, rng: np.random.Generator, *, radius: float, speed: float, turbulence: float) -> "Gusts":
        """Gusts for a disc of `radius` cells that blows `speed` cells/step.

        Wavelengths run from one to four diameters: longer ones bend the jet, shorter ones fray it.
        Frequencies are those of eddies swept through the disc, so they scale with speed / radius.
        """
        unit = rng.standard_normal((GUST_MODES, 3))
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        wavelength = 2.0 * radius * 4.0 ** rng.random((GUST_MODES, 1))
        wave = 2.0 * np.pi / wavelength * unit
        amplitude = np.cross(unit, rng.standard_normal((GUST_MODES, 3)))
        energy = 0.5 * np.sum(amplitude**2)
        return cls(
            wave=wave,
            amplitude=amplitude * turbulence * speed / np.sqrt(energy),
            frequency=np.linalg.norm(wave, axis=1) * speed * rng.standard_normal(GUST_MODES),
            phase=2.0 * np.pi * rng.random(GUST_MODES),
        )

    def at(self, points: Float[np.ndarray, "n 3"], *, time: float) -> Float[np.ndarray, "n 3"]:
        """Velocity at cells (x, y, z), float64: the twin of what `blow` adds to the mean."""
        return np.cos(points @ self.wave.T + self.frequency * time + self.phase) @ self.amplitude


@wp.kernel
def blow(
    cell: wp.array[wp.vec3i],
    source: wp.array[wp.int32],
    mean: wp.array[wp.vec3],
    wave: wp.array2d[wp.vec3],
    amplitude: wp.array2d[wp.vec3],
    frequency: wp.array2d[wp.float32],
    phase: wp.array2d[wp.float32],
    time: float,
    imposed: wp.array3d[wp.vec3],
):
    """Impose each INLET cell's mean velocity plus its source's gusts, cells/step; `cell` counts the shell."""
    n = wp.tid()
    m = source[n]
    c = cell[n]
    x = wp.vec3(float(c[0]), float(c[1]), float(c[2]))
    u = mean[n]
    for a in range(wave.shape[1]):
        u += amplitude[m, a] * wp.cos(wp.dot(wave[m, a], x) + frequency[m, a] * time + phase[m, a])
    imposed[c[2], c[1], c[0]] = u
