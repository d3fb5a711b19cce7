"""What a guide holds and how coarsely it is marched."""

import math
from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from sixway.core.config import Config, parse_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera, Grid, enough_divisions

Direction = Literal["right", "left", "top", "bottom", "front", "back"]

LIGHT_SETS: dict[str, tuple[Direction, ...]] = {
    "front": ("front",),
    "front_lr": ("right", "left", "front"),
    "front_tb": ("front", "top", "bottom"),
    "all": ("right", "left", "top", "bottom", "front", "back"),
}
"""Sets of surrogate lights that go by a name; `front_tb` is the paper's."""

_MARCH_ONLY = {"steps_per_edge": 40, "weight": "exact"}
"""Options that only `lighting: march` reads, with their defaults."""

_SWEEP_ONLY = {"light_grid": 64, "light_samples": 12, "scatter_iterations": 0, "scatter_cells": 2}
"""Options that only `lighting: sweep` reads, with their defaults."""


class GuideConfig(Config):
    """One guide; the defaults are the paper's. Raises ValueError for an option that the lighting does not read."""

    lights: tuple[Direction, ...] = Field(default=("front", "top", "bottom"), min_length=1)
    """Surrogate lights, or the name of one of `LIGHT_SETS`; a config holds the lights themselves."""
    sum_lights: bool = True
    """One ``in_scatter`` channel for all lights (the paper), or one channel a light, by its name."""
    lighting: Literal["march", "sweep"] = "march"
    """``march`` walks to every light from every step of the ray (Algorithm 1). ``sweep`` looks light up in a coarse
    grid of optical depths and samples density at every voxel of the ray: finer, and cheaper with many lights."""
    mip: Literal[1, 2, 4] = 1
    """Average the density over boxes of that many voxels along each edge first."""
    steps_per_edge: int = Field(default=40, ge=4, le=1024)
    """Of a march: the step h is the longest box edge over this, so that the guide does not change with the grid."""
    step_voxels: float | None = Field(default=None, gt=0.0)
    """Step in voxels of the frame instead, as the paper counts (10 of a 400^3 grid). A sweep steps by one voxel of
    its mip where nothing is given."""
    light_grid: int = Field(default=64, ge=4, le=256)
    """Of a sweep: cells of the light grid along the longest edge of the volume."""
    light_samples: int = Field(default=12, ge=1, le=256)
    """Of a sweep: slabs along the box of the smoke. A slab also ends where it gets more opaque than one part in
    that many; each slab with smoke is lit once, weighted by its exact opacity, so there are at most twice as many
    look-ups."""
    scatter_iterations: int = Field(default=0, ge=0, le=64)
    """Of a sweep: times that light may scatter, isotropically after the first, before it scatters to the camera. 1 is
    what a reference with bounces `paper` holds."""
    scatter_cells: Literal[1, 2, 4] = 2
    """Of a sweep: edge of the cells that scattered light is kept on, in cells of the light grid."""
    jitter: bool = True
    """Shift each ray's samples by a seeded part of a step, against banding."""
    pixel_samples: Literal[1, 4, 16] = 1
    """Rays of pixels whose transmittance differs from a neighbour's by more than 0.02, such as those on the edge of an
    obstacle: in a square, and the pixel is their mean. 16 are 4 where pixels are small, see `rays_a_side`."""
    emission: bool = False
    """A channel ``emissive`` as a lightmap has it; 0 for a frame without fire."""
    vertical: Literal["camera_up", "world_up", "omega_cross_z"] = "camera_up"
    """What top and bottom mean; `omega_cross_z` is the printed form, undefined for a view along z."""
    weight: Literal["exact", "paper_literal"] = "exact"
    """Of a march: A_n = T_{n-1} (1 - exp(-sigma h)), or the printed T_{n-1} sigma, which lacks the step length."""

    @field_validator("lights", mode="before")
    @classmethod
    def _lights_of_a_set(cls, lights: Any) -> Any:
        if not isinstance(lights, str):
            return tuple(lights) if isinstance(lights, list) else lights
        if lights not in LIGHT_SETS:
            raise ValueError(f"lights {lights!r} is no light set; use {', '.join(LIGHT_SETS)} or a list of directions")
        return LIGHT_SETS[lights]

    @model_validator(mode="after")
    def _lights_once(self) -> Self:
        if len(set(self.lights)) != len(self.lights):
            raise ValueError(f"lights {self.lights} names a light twice; list each once")
        return self

    @model_validator(mode="after")
    def _options_of_the_lighting(self) -> Self:
        foreign = _SWEEP_ONLY if self.lighting == "march" else _MARCH_ONLY
        for option, default in foreign.items():
            if getattr(self, option) != default:
                raise ValueError(f"lighting {self.lighting} does not read {option}; leave it at {default!r}")
        return self

    @property
    def light_names(self) -> tuple[str, ...]:
        """The lights in the order of `DIRECTIONS`."""
        return tuple(name for name in DIRECTIONS if name in self.lights)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the guide, in order."""
        lit = ("in_scatter",) if self.sum_lights else self.light_names
        return (*lit, "transmittance", "depth", *(("emissive",) if self.emission else ()))

    def step_m(self, grid: Grid) -> float:
        """The step length h [m] of a view ray in that grid."""
        if self.step_voxels is not None:
            return self.step_voxels * grid.voxel_size_m
        if self.lighting == "sweep":
            return self.mip * grid.voxel_size_m
        return max(grid.extent_m) / self.steps_per_edge

    def rays_a_side(self, camera: Camera, grid: Grid) -> int:
        """Rays along an edge of the pixels that get more than one: no more than the reference takes."""
        return min(math.isqrt(self.pixel_samples), enough_divisions(grid, camera))


def stored_guide(identity: Mapping[str, Any], *, source: str) -> GuideConfig:
    """The guide that a manifest or a net's card names. Raises ConfigError if this version cannot march it."""
    return parse_config(GuideConfig, identity, source=source, stored=True)


def same_guide(dataset: Mapping[str, Any], net: Mapping[str, Any]) -> bool:
    """Whether a dataset's guide is the one that a net was trained on, whenever either was written."""
    first, second = stored_guide(dataset, source="the dataset's guide"), stored_guide(net, source="the net's guide")
    return first.identity() == second.identity()
