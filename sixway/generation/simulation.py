"""One scenario run to files: frames in any format, a checkpoint on the way, the same command resumes."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sixway.core.config import dump_config
from sixway.core.records import DensityFrame
from sixway.core.store import (
    append_json_line,
    claim_folder,
    provenance,
    read_json_lines,
    write_json,
    write_text,
)
from sixway.sim.checkpoint import load_checkpoint, save_checkpoint
from sixway.sim.flow.flow import Flow, MakeFlow
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import FlowError, SmokeSolver
from sixway.volumes.read import CHECKPOINT, read_volume
from sixway.volumes.write import write_volume

Format = Literal["npz", "nvdb", "vdb", "vol"]

RECORD = "simulation.json"
INDEX = "frames.jsonl"


@dataclass(frozen=True, kw_only=True)
class SimulationRun:
    """A scenario, where its frames go and as what.

    formats: files of every frame. checkpoint_every: frames between two checkpoints; 0 keeps none. replace: delete what
    was made with other settings. make_flow: see `SmokeSolver`.
    """

    scenario: ScenarioConfig
    out: Path
    formats: tuple[Format, ...] = ("npz",)
    checkpoint_every: int = 10
    device: str = "cpu"
    threads: int = 1
    replace: bool = False
    make_flow: MakeFlow = Flow

    def files(self, number: int) -> list[Path]:
        return [self.out / f"frame_{number:04d}.{suffix}" for suffix in self.formats]

    def missing(self) -> list[int]:
        """Numbers of the frames that are not there yet. Raises ValueError as `claim_folder` does."""
        every = [path for number in range(self.scenario.frames) for path in self.files(number)]
        lost = set(
            claim_folder(
                self.out,
                every,
                record=RECORD,
                settings={"scenario": self.scenario.identity()},
                patterns=("frame_[0-9]*", CHECKPOINT, INDEX),
                replace=self.replace,
            )
        )
        return [number for number in range(self.scenario.frames) if lost.intersection(self.files(number))]

    def run(self) -> Iterator[int]:
        """Make what is missing and yield the number of every frame that was written.

        Goes on from the checkpoint if there is one before the first missing frame. Raises FlowError, which names
        the last checkpoint, if the flow blows up; ValueError for a checkpoint of other settings.
        """
        missing = self.missing()
        if not missing:
            return
        write_text(self.out / "scenario.yaml", dump_config(self.scenario))
        write_json(self.out / "provenance.json", {"seed": self.scenario.seed, **provenance()})
        checkpoint = self.out / CHECKPOINT
        solver = self._solver(checkpoint, first=missing[0])
        try:
            while solver.frames_done <= missing[-1] + self.scenario.warmup_frames:
                solver.advance()
                number = solver.frames_done - 1 - self.scenario.warmup_frames
                if number in missing:
                    frame = solver.frame()
                    for path in self.files(number):
                        write_volume(path, frame)
                    self._record(number, frame)
                if self.checkpoint_every and solver.frames_done % self.checkpoint_every == 0:
                    save_checkpoint(checkpoint, solver)
                if number in missing:
                    yield number
        except FlowError as error:
            kept = f"the last good state is {checkpoint}" if checkpoint.is_file() else "no checkpoint was kept"
            raise FlowError(f"{error}; {kept}") from error

    def _record(self, number: int, frame: DensityFrame) -> None:
        """What formats other than .npz have no place for; of a frame made twice the last line counts."""
        about = {
            "frame": number,
            "time_s": frame.time_s,
            "seed": self.scenario.seed,
            "device": self.device,
            "voxel_size_m": frame.grid.voxel_size_m,
            "origin_m": frame.grid.origin_m,
        }
        append_json_line(self.out / INDEX, about)

    def devices(self) -> list[str]:
        """Where the frames were made; more than one differ in last bits, which turbulence makes grow."""
        return sorted({line["device"] for line in read_json_lines(self.out / INDEX) if "device" in line})

    def some_frames(self, count: int) -> list[DensityFrame]:
        """`count` frames spread evenly over the finished run, the last one among them."""
        numbers = {round((i + 1) * self.scenario.frames / count) - 1 for i in range(count)} - {-1}
        return [read_volume(self.files(number)[0]) for number in sorted(numbers)]

    def _solver(self, checkpoint: Path, *, first: int) -> SmokeSolver:
        solver = self.fresh_solver()
        if checkpoint.is_file():
            load_checkpoint(checkpoint, solver)
            if solver.frames_done > first + self.scenario.warmup_frames:  # an earlier frame was deleted
                solver = self.fresh_solver()
        return solver

    def fresh_solver(self) -> SmokeSolver:
        """The simulation at its start."""
        return SmokeSolver(self.scenario, device=self.device, threads=self.threads, make_flow=self.make_flow)
