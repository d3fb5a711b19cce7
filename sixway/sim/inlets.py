"""Where smoke comes from: discs that blow, with swirl and seeded gusts so that no two plumes are alike."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, model_validator

from sixway.core.config import Config
from sixway.sim.obstacles import Position

GUST_MODES = 24
Component = Annotated[float, Field(ge=-1.0, le=1.0)]


class InletConfig(Config):
    """A disc from which smoke blows."""

    centre_m: Position
    """Centre of the disc [m]; on a wall or inside the box, whose centre is the origin."""
    radius_m: float = Field(gt=0.0, le=100.0)
    """[m]"""
    towards: tuple[Component, Component, Component] = (0.0, 1.0, 0.0)
    """Where it blows to (x, y, z), of any length; +y is up."""
    speed_m_s: float = Field(default=1.0, gt=0.0, le=100.0)
    """Mean speed [m/s]."""
    swirl: float = Field(default=0.0, ge=-1.0, le=1.0)
    """Speed of turning at the rim, as a part of the mean speed; positive is counter-clockwise seen
    from where it blows to."""
    turbulence: float = Field(default=0.2, ge=0.0, le=0.5)
    """Root mean square of the gusts, as a part of the mean speed."""
    density: float = Field(default=1.0, gt=0.0, le=100.0)
    """Density of the smoke that it feeds, unitless."""

    @model_validator(mode="after")
    def _points_somewhere(self) -> "InletConfig":
        length = float(np.linalg.norm(self.towards))
        if length < 1e-3:
            raise ValueError(f"towards={self.towards} has length {length:g}; give it a component such as (0, 1, 0)")
        return self

    @property
    def axis(self) -> Float[np.ndarray, "3"]:
        """Unit vector that it blows along."""
        return np.array(self.towards) / np.linalg.norm(self.towards)

    def covers(self, points_m: Float[np.ndarray, "*n 3"], *, half_thickness_m: float) -> Bool[np.ndarray, "*n"]:
        """Which points lie in the disc, taken that thick to either side."""
        offset = points_m - np.array(self.centre_m)
        height = offset @ self.axis
        radius = np.linalg.norm(offset - height[..., None] * self.axis, axis=-1)
        # a hair of tolerance: centres exactly on the rim must not depend on rounding
        return (np.abs(height) <= half_thickness_m * (1 + 1e-6)) & (radius <= self.radius_m * (1 + 1e-6))

    def mean_velocity(self, points_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Velocity without gusts [m/s] at points of the disc: even blowing plus rigid swirl."""
        turning = np.cross(self.axis, points_m - np.array(self.centre_m)) / self.radius_m
        return self.speed_m_s * (self.axis + self.swirl * turning)

    def rim(self) -> Float[np.ndarray, "n 3"]:
        """Sample points [m] of the disc: its centre, a ring half-way and the rim."""
        helper = np.eye(3)[np.argmin(np.abs(self.axis))]
        u = np.cross(self.axis, helper)
        u /= np.linalg.norm(u)
        v = np.cross(self.axis, u)
        angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[:, None]
        ring = self.radius_m * (np.cos(angle) * u + np.sin(angle) * v)
        return np.array(self.centre_m) + np.concatenate([np.zeros((1, 3)), 0.5 * ring, ring])


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
