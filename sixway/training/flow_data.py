"""Clips of simulated smoke that know how they move: pictures, and the simulator's motion in the image.

One file a simulation, named by the hash of all that made it, written whole: the same call makes only what is missing.
"""

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np
import warp as wp
from jaxtyping import Float
from pydantic import Field, model_validator

from sixway.core.config import Config, ConfigError, load_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import Medium
from sixway.core.store import atomic_path, content_hash
from sixway.guide.config import GuideConfig
from sixway.guide.march import GuideMarcher
from sixway.guide.motion import project_motion_statistics
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver

Split = Literal["train", "val", "test"]

_ARRAYS = ("pictures", "motion", "spread", "alpha")


class ClipSource(Config):
    """One simulation; all its views belong to one split."""

    name: str = Field(pattern=r"^[a-z0-9_]+$")
    scenario: str
    """Path of a scenario file, relative to this config."""
    split: Split
    set: tuple[str, ...] = ()
    """Overrides of the scenario, ``key.subkey=value``. Frames close in time make the sums of motion exact."""
    yaws_deg: tuple[float, ...] = Field(default=(0.0,), min_length=1)


class FlowDataConfig(Config):
    """Which simulations, and how they are seen."""

    sources: tuple[ClipSource, ...] = Field(min_length=1)
    frames: int = Field(default=32, ge=2, le=1000)
    """Consecutive frames of every view."""
    size_px: int = Field(default=128, ge=16, le=1024)
    """Side of the pictures that the net sees; the stored ones are twice that, so that moving them costs no detail."""
    margin: float = Field(default=0.75, ge=0.3, le=4.0)
    extinction_per_m: float = Field(default=40.0, gt=0.0)
    guide: GuideConfig
    """What draws the pictures: the mean of its lights. All six, one channel each."""

    @model_validator(mode="after")
    def _six_lights(self) -> Self:
        if self.guide.sum_lights or set(self.guide.lights) != set(DIRECTIONS):
            raise ValueError("guide: the pictures are the mean of all six maps; set lights: all and sum_lights: false")
        names = [source.name for source in self.sources]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"sources {twice} are named twice; every simulation needs a name of its own")
        return self


@dataclass(frozen=True, kw_only=True)
class Clip:
    """One view of one simulation. pictures: linear mean of the six maps, M = pi L / E, at twice the flow's size.

    motion: [px/frame; right, down], the mean along each ray weighted by what the camera sees of it; spread: its
    standard deviation along the ray [px/frame]; both 0 where there is no smoke. alpha: opacity.
    """

    pictures: Float[np.ndarray, "t hh ww"]
    motion: Float[np.ndarray, "t 2 h w"]
    spread: Float[np.ndarray, "t h w"]
    alpha: Float[np.ndarray, "t h w"]


@dataclass(frozen=True)
class FlowData:
    """The clips of a config in one folder."""

    config: FlowDataConfig
    scenarios: tuple[ScenarioConfig, ...]
    folder: Path

    @classmethod
    def read(cls, config: FlowDataConfig, *, scenarios_from: Path, folder: Path) -> Self:
        """Read the scenarios that the config names. Raises ConfigError, all mistakes at once."""
        scenarios, problems = [], []
        for source in config.sources:
            try:
                scenario = load_config(ScenarioConfig, scenarios_from / source.scenario, source.set)
                scenarios.append(scenario.model_copy(update={"frames": config.frames}))
            except (ConfigError, FileNotFoundError) as error:
                problems.append(f"sources: {source.name}: {error}")
        if problems:
            raise ConfigError("\n".join(problems))
        return cls(config=config, scenarios=tuple(scenarios), folder=folder)

    @property
    def identity(self) -> str:
        """Names the data that training reads: another hash, other pictures."""
        return content_hash([path.name for source, path in self._files() if source.split != "test"])

    def missing(self, splits: tuple[Split, ...]) -> list[str]:
        return [source.name for source, path in self._files() if source.split in splits and not path.is_file()]

    def make(self, splits: tuple[Split, ...], *, device: str, threads: int = 1) -> Iterator[str]:
        """Simulate and draw what is missing; yields the name of each simulation made."""
        for (source, path), scenario in zip(self._files(), self.scenarios, strict=True):
            if source.split in splits and not path.is_file():
                arrays = draw_clips(source, scenario, self.config, device=device, threads=threads)
                with atomic_path(path) as temporary:
                    np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]
                yield source.name

    def clips(self, split: Split) -> list[Clip]:
        """Every view of that split; FileNotFoundError if it has not been made, ValueError if a file is damaged."""
        clips = []
        for source, path in self._files():
            if source.split == split:
                try:
                    with np.load(path) as file:
                        arrays = {name: file[name] for name in _ARRAYS}
                except (KeyError, ValueError, zipfile.BadZipFile) as error:
                    raise ValueError(
                        f"{path}: is damaged ({error}); delete it and run the same command again"
                    ) from error
                for view in range(len(source.yaws_deg)):
                    clips.append(Clip(**{name: array[view] for name, array in arrays.items()}))
        return clips

    def _files(self) -> list[tuple[ClipSource, Path]]:
        plain = GuideConfig().identity()
        shared = self.config.identity()
        del shared["sources"]
        # clips were first named by what their guide has that the plain one has not
        shared["guide"] = {key: value for key, value in shared["guide"].items() if value != plain.get(key)}
        files = []
        for source, scenario in zip(self.config.sources, self.scenarios, strict=True):
            made_by = content_hash([shared, source.yaws_deg, scenario.identity()])
            files.append((source, self.folder / f"{source.name}_{made_by}.npz"))
        return files


def draw_clips(
    source: ClipSource, scenario: ScenarioConfig, config: FlowDataConfig, *, device: str, threads: int
) -> dict[str, np.ndarray]:
    """The arrays of `Clip` in half precision, one more axis first: the views."""
    wp.config.log_level = wp.LOG_WARNING
    medium = Medium(extinction_per_m=config.extinction_per_m)
    marcher = GuideMarcher(config.guide, medium, device=device, threads=threads)
    arrays: dict[str, list[list[np.ndarray]]] = {name: [[] for _ in source.yaws_deg] for name in _ARRAYS}
    for number, frame in enumerate(SmokeSolver(scenario, device=device, threads=threads).frames()):
        for view, yaw in enumerate(source.yaws_deg):
            large, small = (
                Camera.around(frame.grid, yaw_deg=yaw, margin=config.margin, width_px=side, height_px=side)
                for side in (2 * config.size_px, config.size_px)
            )
            guide = marcher.march(frame, large, seed=number)
            motion = project_motion_statistics(
                frame, small, medium, frame_s=scenario.frame_s, device=device, threads=threads
            )
            arrays["pictures"][view].append(np.mean([guide[name] for name in DIRECTIONS], axis=0))
            arrays["motion"][view].append(np.moveaxis(motion.mean, -1, 0))
            arrays["spread"][view].append(np.sqrt(motion.variance.sum(axis=-1)))
            arrays["alpha"][view].append(motion.alpha)
    return {name: np.array(views, dtype=np.float16) for name, views in arrays.items()}
