"""How often does the packing validator tell the truth? Every packing x every single fault on bakes it was not tuned on.

python scripts/validate_packings.py --volumes FOLDER --write docs/packing_validator.md
--volumes names the folder with the real volumes (default: $SIXWAY_REAL_VOLUMES); without it only simulated smoke is
used. --fit prints what the constants of sixway/engines/diagnosis.py were read from: the tuning bakes, never the others.
"""

import os
import sys
import tempfile
from argparse import Namespace
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser

from sixway.bake import main as bake
from sixway.core.config import load_config
from sixway.core.exr import read_exr
from sixway.core.png import to_8bit
from sixway.core.progress import track
from sixway.core.store import write_text
from sixway.engines.alpha import to_straight
from sixway.engines.diagnosis import Pictures, diagnose, opaque, shrunk
from sixway.engines.evidence import layout, rim, size, tone
from sixway.engines.faults import HEALTHY, Fault, damaged, faults_of, healthy, suppose
from sixway.engines.frames import held_channels
from sixway.engines.packing import PACKINGS, Packing
from sixway.sim.scenario import ScenarioConfig
from sixway.sim.solver import SmokeSolver
from sixway.volumes.write import write_volume

SCENARIOS = Path(__file__).parents[1] / "configs/sim"
LEAST_RIGHT = 95.0


@dataclass(frozen=True)
class Bake:
    """source: a file of the real volumes, or ``scenario:seed:frame``. arguments: of sixway.bake."""

    name: str
    source: str
    arguments: str = ""


_ABOVE = "--camera-yaw 60 --camera-pitch 15"
TUNING = (
    Bake("jet, early", "jet:11:6", "--camera-yaw 20"),
    Bake("jet, multi, dense", "jet:11:22", "--bounces multi --optical-depth 14"),
    Bake("jet, single, thin", "jet:11:22", "--camera-yaw 130 --optical-depth 4 --bounces single"),
    Bake("fire 8", "mantaflow_fire/fluid_data_0008.vdb", "--up z"),
    Bake("fire 16, multi", "mantaflow_fire/fluid_data_0016.vdb", "--up z --bounces multi --camera-yaw 70"),
    Bake("fire 24, albedo 0.8", "mantaflow_fire/fluid_data_0024.vdb", "--up z --albedo 0.8 --camera-pitch 20"),
    Bake("fire 32, multi, thin", "mantaflow_fire/fluid_data_0032.vdb", "--up z --optical-depth 3 --bounces multi"),
    Bake(
        "fire 40, g 0.4, dense",
        "mantaflow_fire/fluid_data_0040.vdb",
        "--up z --hg-g 0.4 --camera-yaw 200 --optical-depth 16",
    ),
)
TEST = (
    Bake("jet on a cylinder", "jet_cylinder:12:20", "--camera-yaw 35"),
    Bake("jet on a sphere, multi", "jet_sphere:13:20", "--bounces multi --albedo 0.95 --optical-depth 5"),
    Bake("jet on a sphere, single", "jet_sphere:29:12", "--bounces single --camera-yaw 80 --optical-depth 10"),
    Bake("cloud teapot", "shadeops_teapot_cloud.nvdb"),
    Bake("cloud teapot, multi, above", "shadeops_teapot_cloud.nvdb", f"{_ABOVE} --bounces multi --optical-depth 12"),
    Bake("Mitsuba's plume", "mitsuba_tutorial_volume.vol", "--up z"),
)


def frames(
    bakes: tuple[Bake, ...], volumes: Path | None, folder: Path
) -> Iterator[tuple[Bake, np.ndarray, tuple[str, ...]]]:
    """Each bake at 128 x 128 with its channels; those of missing volumes are left out."""
    for number, one in enumerate(bakes):
        source = Path(one.source)
        if ":" in one.source:
            source = simulated(one.source, folder)
        elif volumes is None or not (volumes / source).exists():
            continue
        else:
            source = volumes / source
        out = folder / f"{one.name.replace(' ', '_').replace(',', '')}_{number}"
        if bake([str(source), "--out", str(out), "--resolution", "128", *one.arguments.split()]):
            raise RuntimeError(f"bake {one.name!r} failed")
        file = out / "frame_0000.exr"
        channels = held_channels(file)
        yield one, read_exr(file, channels), channels


def simulated(source: str, folder: Path) -> Path:
    """One frame of a scenario with another seed, as a volume file."""
    scenario, seed, number = source.split(":")
    path = folder / f"{scenario}_{seed}_{number}.npz"
    if not path.exists():
        solver = SmokeSolver(
            load_config(ScenarioConfig, SCENARIOS / f"{scenario}.yaml", [f"seed={seed}", "resolution=tiny"]),
            device="cpu",
        )
        for _ in range(int(number)):
            solver.advance()
        write_volume(path, solver.frame())
    return path


def pictures_of(
    image: np.ndarray, channels: tuple[str, ...], packing: Packing, fault: Fault
) -> tuple[Pictures, Pictures | None]:
    """What an 8-bit export with that fault looks like to the validator."""
    hypothesis = suppose(healthy(packing, floats=False), fault)
    source = to_straight(image, channels) if hypothesis.straight else image
    stored = [to_8bit(picture).astype(np.float32)[None] / 255.0 for picture in damaged(source, channels, hypothesis)]
    textures = tuple(shrunk(opaque(picture)) for picture in stored)
    if packing.stacked:
        return Pictures((np.concatenate(textures, axis=1),)), Pictures(textures)
    return Pictures(textures), None


@dataclass(frozen=True)
class Trial:
    bake: str
    packing: str
    fault: Fault
    told: bool
    right: bool
    decided: bool
    healthy: bool
    answer: str
    members: int


def trials_of(one: Bake, image: np.ndarray, channels: tuple[str, ...], packing: Packing, every: int) -> list[Trial]:
    """Each `every`th fault of one packing on one bake, with the packing told and not."""
    results = []
    for fault in [HEALTHY, *faults_of(packing)][::every]:
        pictures, stacked = pictures_of(image, channels, packing, fault)
        for told in (True, False):
            top = diagnose(pictures, (packing,) if told else tuple(PACKINGS.values()), stacked=stacked)[0]
            results.append(
                Trial(
                    bake=one.name,
                    packing=packing.name,
                    fault=fault,
                    told=told,
                    right=(packing.name, fault) in top.members,
                    decided=top.confidence >= 0.5,
                    healthy=top.fault == HEALTHY,
                    answer=str(top.fault),
                    members=len(top.members),
                )
            )
    return results


def trials(bakes: list[tuple[Bake, np.ndarray, tuple[str, ...]]], every: int) -> list[Trial]:
    """All packings x faults x bakes, on two processes."""
    cases = [(*one, packing, every) for one in bakes for packing in PACKINGS.values()]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        parts = pool.map(trials_of, *zip(*cases, strict=True))
        return [trial for part in track(parts, total=len(cases), label="trials") for trial in part]


def percent(some: list[Trial]) -> float:
    """Part of the trials that are decided and right."""
    return 100.0 * sum(t.right and t.decided for t in some) / max(len(some), 1)


def report(results: list[Trial], bakes: list[str]) -> str:
    """The Markdown of docs/packing_validator.md."""
    kinds = list(dict.fromkeys(t.fault.kind for t in results))
    untold = [t for t in results if not t.told]
    lines = [
        "# The packing validator, measured",
        "",
        "`python -m sixway.engines.validate A.png B.png` names the packing and the single fault of six-way textures",
        "from the pictures alone. This table is remade by",
        "`python scripts/validate_packings.py --volumes FOLDER --write docs/packing_validator.md`.",
        "",
        f"{len(results) // 2} sets of 8-bit textures: {len(PACKINGS)} packings x each of their single faults x",
        f"{len(bakes)} bakes at 128 x 128 that the validator was not tuned on",
        f"({'; '.join(bakes)}).",
        "Right: the likeliest class of hypotheses, at a confidence of 0.5 or more, holds the true packing and fault.",
        "",
        "| packing | right, packing told [%] | right, nothing told [%] | sets |",
        "|---|---|---|---|",
    ]
    for name in (*PACKINGS, "all"):
        mine = [t for t in results if name in (t.packing, "all")]
        told, free = [t for t in mine if t.told], [t for t in mine if not t.told]
        lines.append(f"| {name} | {percent(told):.1f} | {percent(free):.1f} | {len(free)} |")
    lines += [
        "",
        "By kind of fault, nothing told:",
        "",
        "| fault | right [%] | undecided [%] | sets | hypotheses in the answer |",
        "|---|---|---|---|---|",
    ]
    for kind in kinds:
        mine = [t for t in untold if t.fault.kind == kind]
        members = np.mean([t.members for t in mine])
        undecided = 100.0 * np.mean([not t.decided for t in mine])
        lines.append(f"| {kind} | {percent(mine):.1f} | {undecided:.1f} | {len(mine)} | {members:.1f} |")
    lines += ["", "Each packing x fault, nothing told, right [%] (swapped and missing: all pairs and channels):", ""]
    lines += ["| fault | " + " | ".join(PACKINGS) + " |", "|---" * (len(PACKINGS) + 1) + "|"]
    for kind in kinds:
        cells = [[t for t in untold if (t.fault.kind, t.packing) == (kind, name)] for name in PACKINGS]
        lines.append(f"| {kind} | " + " | ".join(f"{percent(cell):.0f}" if cell else "" for cell in cells) + " |")
    lines += ["", "By bake, nothing told:", "", "| bake | right [%] |", "|---|---|"]
    lines += [f"| {name} | {percent([t for t in untold if t.bake == name]):.1f} |" for name in bakes]
    wrong = Counter(
        (str(t.fault), t.answer if t.decided else "undecidable") for t in untold if not (t.right and t.decided)
    )
    lines += [
        "",
        "Confusion, nothing told: what was answered where the answer was wrong.",
        "",
    ]
    lines += ["| truth | answer | sets |", "|---|---|---|"]
    lines += [f"| {truth} | {answer} | {count} |" for (truth, answer), count in wrong.most_common()] or [
        "| (none) | | 0 |"
    ]
    healthy_sets = [t for t in untold if t.fault == HEALTHY]
    alarms = sum(not t.healthy for t in healthy_sets)
    lines += ["", f"False alarms on healthy textures: {alarms} of {len(healthy_sets)}.", "", UNDECIDABLE]
    return "\n".join(lines) + "\n"


UNDECIDABLE = """\
## What pictures cannot tell, and why

Hypotheses that predict the same pictures are answered as one class; the simplest is named first.

- **Mirrored, or names exchanged.** A picture flipped left-right is the same as maps `right` and `left` in one
  another's place on the mirrored smoke. The same holds for top-bottom, and for a turn by 180 degrees.
- **Swapped with a constant.** A map exchanged with a blank `emissive`, or a missing one, may leave the same files.
- **Packings that differ by a fault.** `embergen_tlr_bbf` with T and R exchanged (as EmberGen 1.0.5 wrote it) stores its
  maps as `rlt_bbf` does; `o3de_rlt` and `rlt_bbf` differ in their alpha file alone.
- **No alpha among the files.** Curves and straight maps show in the relation of the maps to alpha only, and are
  not judged without it.
- **Noise and photographs** are answered "no six-way maps of smoke"; smooth blobs as wide as a third of the picture can
  pass as maps in another order.
- **A blank emissive channel**, motion vectors and occlusion: six-way maps say nothing about them.
- **The brightness scale.** Curves are told by the slope of the maps against alpha first and by their size second, so
  a plume packed at 0.3 to 3 times its brightness, or with albedo 0.2, was still called healthy, its scale unknown.
- **More than one fault.** Maps in any other order are found ("rearranged"); other pairs of faults are not.
- **Thin smoke** (optical depth below about 2) lit by all its own scattering: front and back look alike, and so
  does a side that an overhang shades. The confidence tells.
"""


def fit(bakes: list[tuple[Bake, np.ndarray, tuple[str, ...]]]) -> None:
    """Mean and deviation of each measurement over the tuning bakes, side maps turned into one frame."""
    rows = defaultdict(list)
    for _, image, _ in bakes:
        small = shrunk(image[None, ..., :7])
        measured = layout(small[..., :6])
        for i, (axis, sign) in enumerate(((0, 1), (0, -1), (1, 1), (1, -1))):
            row = measured[i]
            rows["side"].append([sign * row[axis], row[1 - axis], sign * row[2 + axis], row[3 - axis], *row[4:]])
        rows["front"].append(measured[4])
        rows["back"].append(measured[5])
        rows["tone"].append(tone(small[..., :6], small[..., 6]))
        rows["size, rim"].append([size(small[..., :6]), rim(small[..., :6])])
    np.set_printoptions(precision=2, suppress=True, linewidth=120)
    for name, values in rows.items():
        print(f"{name:10s} mean {np.nanmean(values, 0)}\n{'':10s} dev. {np.nanstd(values, 0)}")


def run(options: Namespace) -> int:
    wp.config.log_level = wp.LOG_WARNING
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.cache or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        if options.fit:
            fit(list(frames(TUNING, options.volumes, folder)))
            return 0
        bakes_of = TUNING if options.on_tuning else TEST
        chosen = bakes_of[:3] if options.quick else bakes_of
        bakes = list(frames(chosen, options.volumes, folder))
        results = trials(bakes, every=11 if options.quick else 1)
    names = [one.name for one, _, _ in bakes]
    measurement = Measurement(config={"bakes": names, "sets": len(results) // 2}, repetitions=1)
    for told, label in ((True, "packing told"), (False, "nothing told")):
        for name in (*PACKINGS, "all"):
            mine = [t for t in results if t.told == told and name in (t.packing, "all")]
            measurement.add(
                f"{name}, {label}, right", percent(mine), "%", at_least=None if options.quick else LEAST_RIGHT
            )
        for kind in dict.fromkeys(t.fault.kind for t in results):
            mine = [t for t in results if t.told == told and t.fault.kind == kind]
            measurement.add(
                f"{kind}, {label}, right", percent(mine), "%", at_least=None if options.quick else LEAST_RIGHT
            )
    measurement.add("bakes", len(bakes), "", at_least=3)
    if options.write:
        write_text(options.write, report(results, names))
    return measurement.finish(options.json)


def main() -> int:
    options = parser(__doc__.splitlines()[0])
    real = os.environ.get("SIXWAY_REAL_VOLUMES")
    options.add_argument("--volumes", type=Path, default=Path(real) if real else None, help="folder with real volumes")
    options.add_argument("--cache", type=Path, help="keep bakes here (default: a temporary folder)")
    options.add_argument("--write", type=Path, help="write the report as Markdown")
    options.add_argument("--on-tuning", action="store_true", help="judge the tuning bakes instead, to try changes out")
    options.add_argument("--fit", action="store_true", help="print the measurements of the tuning bakes")
    return run(options.parse_args())


if __name__ == "__main__":
    sys.exit(main())
