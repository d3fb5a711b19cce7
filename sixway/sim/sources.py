"""Where air and smoke come from: discs that blow, winds through a face, puffs that are let go.

Discs and winds carry seeded gusts, so that no two plumes are alike.
"""

from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, model_validator

from sixway.core.config import Config
from sixway.sim.bodies.motion import Position
from sixway.sim.flow.faces import Side

Component = Annotated[float, Field(ge=-1.0, le=1.0)]


class Smoke(Config):
    """What a source keeps up where it is."""

    density: float = Field(default=1.0, ge=0.0, le=100.0)
    """Density of the smoke, unitless."""
    temperature_k: float = Field(default=0.0, ge=0.0, le=10_000.0)
    """Above the air around it [K]."""
    fuel: float = Field(default=0.0, ge=0.0, le=100.0)
    """Fuel that has not burnt, unitless; needs `burn` in the scenario."""


class InletConfig(Smoke):
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
    profile: Literal["plug", "parabolic"] = "plug"
    """Speed over the disc: the same everywhere, or a parabola that is zero at the rim, of the same mean."""
    turbulence: float = Field(default=0.2, ge=0.0, le=0.5)
    """Root mean square of the gusts, as a part of the mean speed."""

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
        """Velocity without gusts [m/s] at points of the disc: its profile plus rigid swirl."""
        turning = np.cross(self.axis, points_m - np.array(self.centre_m)) / self.radius_m
        along = np.ones(len(points_m))
        if self.profile == "parabolic":
            along = 2.0 * np.maximum(1.0 - np.sum(turning**2, axis=1), 0.0)  # radius of a point: |turning|
        return self.speed_m_s * (along[:, None] * self.axis + self.swirl * turning)

    @property
    def peak_m_s(self) -> float:
        """Highest speed that gusts of three sigma reach [m/s]."""
        shape = {"plug": 1.0, "parabolic": 2.0}[self.profile]
        return self.speed_m_s * (shape + abs(self.swirl) + 3.0 * self.turbulence)

    def rim(self) -> Float[np.ndarray, "n 3"]:
        """Sample points [m] of the disc: its centre, a ring half-way and the rim."""
        helper = np.eye(3)[np.argmin(np.abs(self.axis))]
        u = np.cross(self.axis, helper)
        u /= np.linalg.norm(u)
        v = np.cross(self.axis, u)
        angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[:, None]
        ring = self.radius_m * (np.cos(angle) * u + np.sin(angle) * v)
        return np.array(self.centre_m) + np.concatenate([np.zeros((1, 3)), 0.5 * ring, ring])


class WindConfig(Config):
    """Clear air that blows in through a whole face of the box, and fills the box when the simulation starts."""

    face: Side
    """The side of the box that it comes in through; the one opposite must be open."""
    speed_m_s: float = Field(gt=0.0, le=100.0)
    """Speed [m/s] at the top of the box, straight into it."""
    shear: float = Field(default=0.0, ge=0.0, le=1.0)
    """Power law of the height above the floor, u ~ y^shear: 0 is even, 1/7 is wind over open country."""
    turbulence: float = Field(default=0.1, ge=0.0, le=0.5)
    """Root mean square of the gusts, as a part of the speed."""

    @property
    def inwards(self) -> Float[np.ndarray, "3"]:
        """Unit vector that it blows along."""
        vector = np.zeros(3)
        vector["xyz".index(self.face[0])] = 1.0 if self.face.endswith("low") else -1.0
        return vector

    def mean_velocity(self, points_m: Float[np.ndarray, "*n 3"], *, floor_m: float, height_m: float) -> np.ndarray:
        """Velocity without gusts [m/s] at points of the box, [*n, 3]."""
        height = np.clip((points_m[..., 1] - floor_m) / height_m, 0.0, 1.0)
        return self.speed_m_s * (height**self.shear)[..., None] * self.inwards

    @property
    def peak_m_s(self) -> float:
        """Highest speed that gusts of three sigma reach [m/s]."""
        return self.speed_m_s * (1.0 + 3.0 * self.turbulence)


class PuffConfig(Smoke):
    """A ball of smoke, hot gas or fuel that is let go at one moment, or kept up for a while."""

    centre_m: Position
    """[m]"""
    radius_m: float = Field(gt=0.0, le=100.0)
    """[m]"""
    roughness: float = Field(default=0.3, ge=0.0, le=0.9)
    """How far its surface wanders in and out, as a part of the radius; seeded."""
    start_s: float = Field(default=0.0, ge=0.0, le=1e4)
    """When it appears [s]."""
    duration_s: float = Field(default=0.0, ge=0.0, le=1e4)
    """How long it is kept up [s]; 0 lets it go at once."""

    def covers(self, points_m: Float[np.ndarray, "*n 3"], *, seed: tuple[int, ...]) -> Bool[np.ndarray, "*n"]:
        """Which points lie in it. Its surface is a sum of few waves over the sphere, drawn from the seed."""
        rng = np.random.default_rng(seed)
        offset = points_m - np.array(self.centre_m)
        distance = np.linalg.norm(offset, axis=-1)
        towards = offset / np.maximum(distance, 1e-12)[..., None]
        modes = 8
        waves = rng.standard_normal((modes, 3)) * np.linspace(1.0, 4.0, modes)[:, None]
        phase = rng.uniform(0.0, 2.0 * np.pi, modes)
        bulge = np.zeros(distance.shape)
        for wave, shift in zip(waves, phase, strict=True):
            bulge += np.cos(towards @ wave + shift)
        bulge *= self.roughness / np.sqrt(modes)
        return distance <= self.radius_m * np.maximum(1.0 + bulge, 0.1)
