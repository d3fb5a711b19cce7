"""Smoke for the studies of shading: frames of our own simulations and volumes of other people.

Real volumes are taken from the folder that SIXWAY_REAL_VOLUMES names, if it names one.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sixway.core.config import load_config
from sixway.core.frames import Grid
from sixway.core.records import DensityFrame, Medium
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver
from sixway.volumes.extinction import extinction_for_optical_depth
from sixway.volumes.read import Up, read_volume

_CONFIGS = Path(__file__).parents[1] / "configs/sim"
_SIMULATED = (("jet", 40), ("two_jets", 40), ("plume", 40), ("explosion", 20), ("paper_09", 40))
_REAL: tuple[tuple[str, Up], ...] = (("shadeops_teapot_cloud.nvdb", "y"), ("mitsuba_tutorial_volume.vol", "z"))
_LONGEST_VOXELS = 96
OPTICAL_DEPTH = 8.0
"""Of the thick columns of every volume."""


@dataclass(frozen=True, kw_only=True)
class StudyVolume:
    """Smoke with neither fire nor solids, its box 1 m long, and its medium."""

    name: str
    frame: DensityFrame
    medium: Medium


def study_volumes(*, quick: bool) -> list[StudyVolume]:
    """Two for a quick look, else all."""
    found = [_simulated(name, frames) for name, frames in _SIMULATED[: 2 if quick else None]]
    folder = os.environ.get("SIXWAY_REAL_VOLUMES")
    if folder and not quick:
        found += [_real(Path(folder) / name, up) for name, up in _REAL]
    return found


def _simulated(name: str, frames: int) -> StudyVolume:
    solver = SmokeSolver(load_config(ScenarioConfig, _CONFIGS / f"{name}.yaml", ["resolution=tiny"]), device="cpu")
    for _ in range(frames):
        solver.advance()
    return _plain(name, solver.frame())


def _real(path: Path, up: Up) -> StudyVolume:
    return _plain(path.name.split("_")[0] + " " + path.name.split("_")[1], read_volume(path, up=up))


def _plain(name: str, frame: DensityFrame) -> StudyVolume:
    """What the smoke fills of its box, at most 96 voxels long, in a box of 1 m around the origin."""
    factor = -(-max(frame.grid.shape_zyx) // _LONGEST_VOXELS)
    density = frame.density
    if factor > 1:
        density = np.pad(density, [(0, -size % factor) for size in density.shape])
        z, y, x = (size // factor for size in density.shape)
        density = density.reshape(z, factor, y, factor, x, factor).mean(axis=(1, 3, 5)).astype(np.float32)
    filled = [np.flatnonzero((density > 1e-3 * density.max()).any(axis=others)) for others in ((1, 2), (0, 2), (0, 1))]
    density = density[tuple(slice(int(at[0]), int(at[-1]) + 1) for at in filled)]
    z, y, x = density.shape
    plain = DensityFrame(density=np.ascontiguousarray(density), grid=Grid.centred((z, y, x)))
    medium = Medium(extinction_per_m=extinction_for_optical_depth(plain, optical_depth=OPTICAL_DEPTH))
    return StudyVolume(name=name, frame=plain, medium=medium)
