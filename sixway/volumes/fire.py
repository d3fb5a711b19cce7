"""Which grid of a file burns, and how its values become emission [1/m]."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.boxes import common_grid, moved
from sixway.volumes.limits import VolumeError
from sixway.volumes.listing import GridInfo
from sixway.volumes.nanovdb import list_nanovdb, read_nanovdb_values
from sixway.volumes.npz import list_npz, read_npz_values
from sixway.volumes.vdb import list_vdb, read_vdb_values

FIRE_NAMES = ("emission", "emissive", "flame", "flames", "fire", "burn")
"""Grids that are fire by their name, in any case of letters, the first one held. Smoke without fire has
temperature too, and fuel is what has not burnt yet: such grids have to be named."""

_HEAT_NAMES = ("temperature", "heat")
_IGNITION = 1.5  # of unitless temperatures: where Mantaflow's fuel ignites; it burns at up to 3
_DRAPER_K = 798.0  # below it solids, soot among them, do not glow visibly (Draper 1847)
_KELVIN = 50.0  # unitless temperatures stay below, the air of a room in kelvin is far above


@dataclass(frozen=True, kw_only=True)
class EmissionRule:
    """Emission = strength_per_m * value**power, or strength_per_m * max(0, value / threshold - 1)**power.

    grid_name: the grid that burns; None takes the first of `FIRE_NAMES`, and no fire where there is none.
    strength_per_m: radiance that a metre of value 1 adds along a ray. None is 1 for one frame; a sequence
    takes what gives its brightest frame radiance 2 through its thick columns, before smoke takes its share.
    threshold: of temperatures, where glow begins; 0 takes the value itself, as flames, which run from 0 to 1,
    want it. None is 0, but for grids named temperature or heat 798 K, or 1.5 if no value is above 50.
    Negative values are dark. Raises ValueError for numbers out of range.
    """

    grid_name: str | None = None
    strength_per_m: float | None = None
    threshold: float | None = None
    power: float = 1.0

    def __post_init__(self) -> None:
        if self.strength_per_m is not None and not 0.0 < self.strength_per_m < math.inf:
            raise ValueError(f"emission strength {self.strength_per_m} 1/m must be positive and finite")
        if self.threshold is not None and not 0.0 <= self.threshold < math.inf:
            raise ValueError(f"emission threshold {self.threshold} must be 0 or positive, and finite")
        if not 0.0 < self.power < math.inf:
            raise ValueError(f"emission power {self.power} must be positive and finite")

    def emission(self, values: Float[np.ndarray, "z y x"], name: str) -> Float[np.ndarray, "z y x"]:
        """Emission [1/m] of a grid's values, float32. Raises ValueError if it is NaN or infinite."""
        threshold = self._threshold(values, name)
        with np.errstate(over="ignore", invalid="ignore"):
            glow = np.maximum(values / threshold - 1.0 if threshold else values, 0.0) ** self.power
            emission = (glow * (self.strength_per_m or 1.0)).astype(np.float32)
        if not np.isfinite(emission).all():
            raise ValueError(
                f"grid {name!r} holds NaN, infinite or far too large values, which is no fire; repair it, or leave "
                "it out with --emission none"
            )
        return emission

    def _threshold(self, values: Float[np.ndarray, "z y x"], name: str) -> float:
        if self.threshold is not None:
            return self.threshold
        if name.lower() not in _HEAT_NAMES:
            return 0.0
        return _DRAPER_K if values.max() > _KELVIN else _IGNITION


def with_fire(path: Path, frame: DensityFrame, rule: EmissionRule | None) -> DensityFrame:
    """The frame of a file with the emission that the file's grids give by the rule; None takes it away.

    The box grows where fire reaches beyond the smoke. A grid that is empty, as late frames of a fire have it,
    is emission 0; a file without fire leaves the frame without emission. Formats of one grid have none.
    Raises VolumeError if the grid named is missing or no scalar fog, or has voxels of another size.
    """
    if rule is None:
        return replace(frame, emission=None)
    name = _burning(path, rule)
    if name is None:
        return replace(frame, emission=None)
    values, grid = _read(path, name)
    emission = rule.emission(values, name)
    if not emission.any():
        return replace(frame, emission=np.zeros_like(frame.density))
    if grid == frame.grid:
        return replace(frame, emission=emission)
    smoke = (f"its density in {path.name}", frame.grid)
    fire = (f"{path}: grid {name!r}", grid)
    box = common_grid([smoke, fire]) if frame.density.any() else grid
    return DensityFrame(
        density=moved(frame.density, frame.grid, box),
        grid=box,
        time_s=frame.time_s,
        emission=moved(emission, grid, box),
    )


def _burning(path: Path, rule: EmissionRule) -> str | None:
    """Name of the grid that burns. Raises VolumeError if the one that the rule names is not there."""
    held = _list(path)
    if rule.grid_name is None:
        return _first_fire(grid for grid in held if grid.is_smoke)
    if rule.grid_name not in [grid.name for grid in held]:
        known = ", ".join(map(str, held)) or "its density alone"
        raise VolumeError(
            f"{path}: holds no grid {rule.grid_name!r} (it holds: {known}); name one of these with --emission"
        )
    return rule.grid_name


def _first_fire(grids: Iterable[GridInfo]) -> str | None:
    names = {grid.name.lower(): grid.name for grid in grids}
    return next((names[wanted] for wanted in FIRE_NAMES if wanted in names), None)


def _list(path: Path) -> list[GridInfo]:
    match path.suffix.lower():
        case ".vdb":
            return list_vdb(path, boxes=False)
        case ".nvdb":
            return list_nanovdb(path, boxes=False)
        case ".npz":
            return list_npz(path)
    return []


def _read(path: Path, name: str) -> tuple[Float[np.ndarray, "z y x"], Grid]:
    match path.suffix.lower():
        case ".vdb":
            return read_vdb_values(path, grid_name=name)
        case ".nvdb":
            return read_nanovdb_values(path, grid_name=name)
    return read_npz_values(path, name)
