"""What a dataset is to hold, and where each piece of it goes.

Every folder of frames is named by the hash of all that made it, so a changed setting makes new folders
and touches no old ones, and a raised count makes only what is new.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from sixway.core.config import Config, ConfigError, load_config
from sixway.core.records import Medium
from sixway.core.store import content_hash
from sixway.data.manifest import Split
from sixway.generation.cameras import DatasetView, Views, views_around
from sixway.guide.march import GuideConfig
from sixway.reference.lightmaps import ReferenceConfig
from sixway.sim.scenario import ScenarioConfig


class SimulationEntry(Config):
    """One simulation of the dataset and the split that all of it belongs to."""

    name: str = Field(pattern=r"^[a-z0-9_]+$")
    scenario: str
    """Path of a scenario file, relative to the dataset's config."""
    split: Split
    set: tuple[str, ...] = ()
    """Overrides of the scenario, ``key.subkey=value``."""
    pairs: int | None = Field(default=None, ge=1)
    """Pairs of frames taken of this one, instead of `DatasetConfig.pairs_per_simulation`."""


class MediumConfig(Config):
    """How the smoke meets light; see `core.records.Medium`."""

    extinction_per_m: float = Field(gt=0.0)
    albedo: float = Field(default=1.0, ge=0.0, le=1.0)
    hg_g: float = Field(default=0.0, ge=-0.95, le=0.95)

    @property
    def medium(self) -> Medium:
        return Medium(extinction_per_m=self.extinction_per_m, albedo=self.albedo, hg_g=self.hg_g)


class DatasetConfig(Config):
    """A dataset: simulations, views, pairs of consecutive frames, guide variants and references."""

    name: str = Field(pattern=r"^[a-z0-9_]+$")
    seed: int = Field(default=0, ge=0)
    simulations: tuple[SimulationEntry, ...] = Field(min_length=1)
    views: tuple[Views, ...] = Field(min_length=1)
    """Sets of cameras; every simulation is seen by all of them."""
    test_views: tuple[Views, ...] = ()
    """Cameras of the val and test simulations, if others than `views`."""
    pairs_per_simulation: int = Field(ge=1)
    """Pairs of consecutive frames taken of each simulation; raising it keeps those already made."""
    medium: MediumConfig
    guides: dict[str, GuideConfig] = Field(min_length=1)
    """Guide variants by name; all are marched, training picks one."""
    reference: ReferenceConfig
    test_samples_factor: int = Field(default=4, ge=1)
    """Samples of the val and test references, as a multiple of the training ones."""
    noise_of: tuple[Split, ...] = ("train", "val", "test")
    """Splits whose references are made in two halves that tell their noise, at up to twice the time."""

    @model_validator(mode="after")
    def _names_once(self) -> Self:
        names = [entry.name for entry in self.simulations]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"simulations {twice} are named twice; every simulation needs a name of its own")
        bad = [name for name in self.guides if not name.isidentifier()]
        if bad:
            raise ValueError(f"guide variants {bad} must be plain names such as paper")
        return self


@dataclass(frozen=True)
class PlannedSimulation:
    """One simulation with its scenario read, and the frames of it that the dataset takes."""

    name: str
    split: Split
    scenario: ScenarioConfig
    frames: tuple[int, ...]
    views: tuple[DatasetView, ...]


@dataclass(frozen=True)
class Folder:
    """One folder of frames: its path below the dataset, and the settings that its hash stands for."""

    path: str
    made_by: dict[str, Any]


@dataclass(frozen=True)
class Plan:
    """A dataset config with its scenarios, cameras, frames and folders worked out."""

    config: DatasetConfig
    simulations: tuple[PlannedSimulation, ...]

    @classmethod
    def read(cls, path: Path, overrides: tuple[str, ...] = ()) -> Self:
        """Read a dataset config and the scenarios that it names. Raises ConfigError, all at once."""
        config = load_config(DatasetConfig, path, overrides)
        simulations, problems = [], []
        for entry in config.simulations:
            try:
                scenario = load_config(ScenarioConfig, path.parent / entry.scenario, entry.set)
                simulations.append(_simulation(entry, scenario, config))
            except (ConfigError, FileNotFoundError) as error:
                problems.append(f"{path}: simulations: {entry.name}: {error}")
        if problems:
            raise ConfigError("\n".join(problems))
        return cls(config=config, simulations=tuple(simulations))

    def density(self, simulation: PlannedSimulation) -> Folder:
        return _folder("density", simulation.name, made_by={"scenario": simulation.scenario.identity()})

    def target(self, simulation: PlannedSimulation, view: DatasetView) -> Folder:
        """Reference frames, of one trace or the means of two (`HalvedTracer`); scored simulations get more samples."""
        reference = self.reference(simulation).identity()
        traces = 2 if self.tells_noise(simulation) else 1
        return self._of_view("target", simulation, view, {"reference": reference, "traces": traces})

    def guide(self, name: str, simulation: PlannedSimulation, view: DatasetView) -> Folder:
        return self._of_view(f"guide_{name}", simulation, view, {"guide": self.config.guides[name].identity()})

    def flow(self, simulation: PlannedSimulation, view: DatasetView) -> Folder:
        return self._of_view("flow", simulation, view, {})

    def reference(self, simulation: PlannedSimulation) -> ReferenceConfig:
        reference = self.config.reference
        if simulation.split == "train":
            return reference
        return reference.model_copy(update={"samples": reference.samples * self.config.test_samples_factor})

    def tells_noise(self, simulation: PlannedSimulation) -> bool:
        return simulation.split in self.config.noise_of

    def seed(self, simulation: PlannedSimulation, view: DatasetView, frame: int) -> int:
        """One seed for every frame and view of the guides, whatever the order in which they are made."""
        return int(content_hash([self.config.seed, simulation.name, view.name, frame])[:7], 16)

    def frame_seed(self, simulation: PlannedSimulation, frame: int) -> int:
        """One seed for all references of a frame, so that its views can share the light that is the same for all."""
        return int(content_hash([self.config.seed, simulation.name, frame])[:7], 16)

    def _of_view(self, layer: str, simulation: PlannedSimulation, view: DatasetView, made_by: dict[str, Any]) -> Folder:
        everything = {
            **made_by,
            "seed": self.config.seed,
            "medium": self.config.medium.identity(),
            "view": view.made_by,
            "density": self.density(simulation).path,
        }
        return _folder(layer, simulation.name, view.name, made_by=everything)


def _folder(*parts: str, made_by: dict[str, Any]) -> Folder:
    return Folder(path="/".join((*parts, content_hash(made_by))), made_by=made_by)


def _simulation(entry: SimulationEntry, scenario: ScenarioConfig, config: DatasetConfig) -> PlannedSimulation:
    most = scenario.frames // 2
    key, pairs = (
        ("pairs_per_simulation", config.pairs_per_simulation) if entry.pairs is None else ("pairs", entry.pairs)
    )
    if pairs > most:
        raise ConfigError(
            f"{key}={pairs} needs {2 * pairs} frames, its scenario hands over {scenario.frames}; "
            f"lower the pairs to {most} or raise frames"
        )
    sets = config.test_views if config.test_views and entry.split != "train" else config.views
    return PlannedSimulation(
        name=entry.name,
        split=entry.split,
        scenario=scenario,
        frames=pair_frames(scenario.frames, pairs),
        views=views_around(scenario.density_grid, sets, seed=[config.seed, entry.name]),
    )


def pair_frames(num_frames: int, num_pairs: int) -> tuple[int, ...]:
    """The frames of `num_pairs` pairs (2i, 2i + 1), spread over the sequence, in order of time.

    Pairs are taken in bit-reversed order (van der Corput), so a larger count keeps every earlier pair.
    """
    most = num_frames // 2
    bits = max(1, (most - 1).bit_length())
    spread = [int(f"{i:0{bits}b}"[::-1], 2) for i in range(1 << bits)]
    starts = sorted([i for i in spread if i < most][:num_pairs])
    return tuple(frame for start in starts for frame in (2 * start, 2 * start + 1))
