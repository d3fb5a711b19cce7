"""What each part of the method is worth: the base config without one part at a time, several seeds, equal steps.

python scripts/ablate.py configs/train/cpu.yaml --steps 2000 --seeds 3 --out runs/ablation [key=value ...]

Each run trains and is evaluated in processes of its own, two at a time with one thread each. The same command goes
on where it stopped; what is finished is not done again. scripts/make_results.py takes the folder as --ablation.
"""

import argparse
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from sixway.core.command import status_of
from sixway.core.config import load_config
from sixway.core.store import read_json
from sixway.training.loop import TrainConfig

VARIANTS: dict[str, tuple[str, ...]] = {
    "full": (),
    "no_adapters": ("net.adapters=false",),
    "no_perceptual": ("loss.perceptual=0",),
    "no_flow": ("loss.flow=0",),
    "linear_colour": ("loss.colour=linear",),
}
"""Overrides of the base config."""

REPORT = "report_test/report.json"
LOG = "ablate.log"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One variant with one seed."""

    variant: str
    seed: int
    folder: Path
    base: Path
    overrides: tuple[str, ...]
    config: TrainConfig
    """What base and overrides come to."""
    perceived_every: int

    @property
    def is_done(self) -> bool:
        """Whether a report of this very config is there; of another one, training will refuse the folder."""
        report = self.folder / REPORT
        return report.is_file() and read_json(report)["training"]["config"] == self.config.identity()

    @property
    def commands(self) -> tuple[list[str], list[str]]:
        """Training, then evaluation."""
        train = ["sixway.train", str(self.base), *self.overrides, "--run-dir", str(self.folder)]
        evaluate = ["sixway.evaluate", str(self.folder), "--perceived-every", str(self.perceived_every)]
        return [sys.executable, "-m", *train], [sys.executable, "-m", *evaluate]

    def run(self) -> tuple[str, int, float]:
        """Name, status and seconds; what the commands say goes to a log in the folder."""
        started = time.perf_counter()
        self.folder.mkdir(parents=True, exist_ok=True)
        environment = os.environ | {"OMP_NUM_THREADS": "1"}
        status = 0
        with (self.folder / LOG).open("a", encoding="utf-8") as log:
            for command in self.commands:
                status = status or subprocess.run(command, stdout=log, stderr=log, env=environment).returncode
        return f"{self.variant}, seed {self.seed}", status, time.perf_counter() - started


def planned(options: argparse.Namespace) -> list[Trial]:
    """All trials, seed by seed, so that every variant has a result before any has its second.

    Raises ConfigError if a variant does not fit the base config, ValueError if it changes nothing there.
    """
    shared = (*(() if options.steps is None else (f"train.steps={options.steps}",)), *options.overrides)
    trials = []
    for seed in range(options.seeds):
        seeded = (*shared, f"train.seed={seed}")
        for variant in options.only or VARIANTS:
            overrides = (*seeded, *VARIANTS[variant])
            config = load_config(TrainConfig, options.config, overrides)
            if VARIANTS[variant] and config == load_config(TrainConfig, options.config, seeded):
                raise ValueError(f"{variant}: {options.config} is without it already; leave it out with --only")
            trials.append(
                Trial(
                    variant=variant,
                    seed=seed,
                    folder=options.out / variant / f"seed{seed}",
                    base=options.config,
                    overrides=overrides,
                    config=config,
                    perceived_every=options.perceived_every,
                )
            )
    return trials


def _run(options: argparse.Namespace) -> int:
    trials = planned(options)
    left = [trial for trial in trials if not trial.is_done]
    print(f"{len(trials)} runs, {len(trials) - len(left)} of them done; {options.workers} at a time")
    if options.dry_run:
        for trial in left:
            print(*trial.commands[0][1:])
        print("dry run: nothing was trained")
        return 0
    failed, started = [], time.perf_counter()
    with ThreadPoolExecutor(options.workers) as pool:
        for number, (name, status, seconds) in enumerate(pool.map(Trial.run, left), start=1):
            gone = time.perf_counter() - started
            rest = gone / number * (len(left) - number)
            print(
                f"{number}/{len(left)} {name}: {'done' if status == 0 else f'FAILED with {status}'} in "
                f"{seconds / 60.0:.1f} min; about {rest / 60.0:.0f} min left",
                flush=True,
            )
            failed += [name] if status else []
    for trial in trials:
        if trial.is_done:
            maps = read_json(trial.folder / REPORT)["methods"]["net"]["psnr"]["maps"]
            print(f"{trial.variant:>15}, seed {trial.seed}: {maps['mean_of_psnr_db']:.2f} dB")
    if failed:
        print(f"error: {', '.join(failed)} failed; see {LOG} in its folder", file=sys.stderr)
    return 1 if failed else 0


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("config", type=Path, help="training config that has all parts")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="overrides for all runs, such as data=...")
    parser.add_argument("--steps", type=int, help="steps of each run (default: the config's)")
    parser.add_argument("--seeds", type=int, default=3, help="runs of each variant (default: 3)")
    parser.add_argument("--only", nargs="+", choices=tuple(VARIANTS), help="these variants alone")
    parser.add_argument("--out", type=Path, default=Path("runs/ablation"))
    parser.add_argument("--workers", type=int, default=2, help="runs at a time, one thread each (default: 2)")
    parser.add_argument("--perceived-every", type=int, default=10, help="as python -m sixway.evaluate has it")
    parser.add_argument("--dry-run", action="store_true", help="print the training commands, run nothing")
    options = parser.parse_intermixed_args(arguments)
    return status_of(lambda: _run(options))


if __name__ == "__main__":
    sys.exit(main())
