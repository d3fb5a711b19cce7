"""Makes docs/results.md from the reports of runs and of scripts, and from nothing else.

python scripts/make_results.py runs/cpu_rich runs/cpu_paper --ablation runs/ablation --guides guides.json
    --floors floors.json --volumes volumes.json --inference inference.json --out docs/results.md

Runs are folders that `python -m sixway.evaluate` has been through, the main one first. The JSON files are what scripts
write with --json; a picture of the same name beside one (guides.png) is shown with it. What is absent is named so.
"""

import argparse
import shlex
import statistics
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from sixway.core.command import status_of
from sixway.core.store import atomic_path, provenance, read_json, write_text
from sixway.evaluation.report import sparse
from sixway.evaluation.tables import Table, axis_tables, db, fire_table, main_table, map_table, time_table

PAPER_DB = 40.85
"""Average PSNR of the paper's best guide on its unseen simulation (its Table 2)."""

WITHIN_DB = 2.0

MEASURED = {
    "guides": ("The guide: cost and quality", "python scripts/study_guides.py --json guides.json"),
    "floors": ("Why a net at all?", "python scripts/study_floor_renderers.py RUN --json floors.json"),
    "volumes": (
        "Volumes unlike the training data",
        "python scripts/validate_volumes.py RUN FOLDER --json volumes.json",
    ),
    "inference": ("Speed", "python scripts/bench_inference.py RUN --json inference.json"),
    "exports": ("Exported files", "python scripts/validate_exports.py RUN --data DATA --json exports.json"),
    "training": ("Speed of training", "python scripts/bench_training.py --json training.json"),
}
"""Sections made from the rows of other scripts, and how to run those."""

Report = Mapping[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path, help="folders of evaluated runs, the main one first")
    parser.add_argument("--ablation", type=Path, help="folder of scripts/ablate.py")
    for name, (title, _) in MEASURED.items():
        parser.add_argument(f"--{name}", type=Path, metavar="JSON", help=f"rows of the section {title!r}")
    parser.add_argument("--out", type=Path, default=Path("docs/results.md"))
    options = parser.parse_args(arguments)
    words = ["python", "scripts/make_results.py", *(sys.argv[1:] if arguments is None else arguments)]
    return status_of(lambda: _write(options, shlex.join(words)))


def _write(options: argparse.Namespace, command: str) -> int:
    reports = {run.name: read_report(run) for run in options.runs}
    if len(reports) < len(options.runs):
        raise ValueError(f"runs {[str(run) for run in options.runs]} must differ in the names of their folders")
    images = options.out.parent / "images"
    parts = [
        "# Results",
        f"Made by `{command}`; every number comes from a report, none is typed.",
        _summary(reports),
        f"## Runs\n\n{_runs(reports, options.runs)}",
        _shown(main_table(reports)),
        " ".join(f"{name}: {report['frames']} frames; {sparse(dict(report))}" for name, report in reports.items()),
        *(_shown(table) for table in [map_table(reports), *axis_tables(reports)]),
        _shown(fire) if (fire := fire_table(reports)) else "## Fire\n\nNo frame of the test split burns.",
        _shown(time_table(reports)),
        _ablation(options.ablation),
    ]
    for name, (title, how) in MEASURED.items():
        parts.append(f"## {title}\n\n{_measured(getattr(options, name), how, images)}")
    parts.append(_pictures(options.runs[0], next(iter(reports.values())), images))
    write_text(options.out, "\n\n".join(part.strip() for part in parts) + "\n")
    print(f"{options.out}: {len(reports)} runs")
    return 0


def read_report(run: Path) -> Report:
    """The test report of a run. Raises FileNotFoundError that says how to make it."""
    path = run / "report_test/report.json"
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no report here; run: python -m sixway.evaluate {run}")
    report: Report = read_json(path)
    return report


def _summary(reports: Mapping[str, Report]) -> str:
    """What was aimed at and what came out, run by run."""
    lines = []
    for name, report in reports.items():
        maps = report["methods"]["net"]["psnr"]["maps"]
        value, quoted = maps["mean_of_psnr_db"], report["headline"]
        paper = f"{'above' if value >= PAPER_DB else 'below'} the {PAPER_DB} dB of the paper, which are of other smoke"
        lines.append(
            f"- **{name}** (guide `{report['guide']}`): {db(value)} dB mean over {quoted['frames']} frames of "
            f"{quoted['width_px']} x {quoted['height_px']}, {paper}; max / min {db(maps['highest_db'])} / "
            f"{db(maps['lowest_db'])}; PSNR of the mean MSE {db(maps['psnr_of_mean_mse_db'])} dB; worst simulation "
            f"{report['methods']['net']['worst_simulation']}."
        )
        for axis in ("size", "density"):
            rows = [row for row in report["breakdown"][axis] if row["apart_db"]]
            for row in rows:
                verdict = "within" if row["apart_db"] >= -WITHIN_DB else "MISSED: not within"
                lines.append(f"  - {axis} {row['label']}: {row['apart_db']:+.2f} dB, {verdict} {WITHIN_DB:g} dB")
            if not rows:
                lines.append(f"  - {axis}: the test split has only one")
        ceiling = report["ceiling_psnr_db"]
        lines.append(f"  - ceiling: {f'{ceiling:.2f} dB' if ceiling else 'not measured'}")
    return "\n".join(lines)


def _runs(reports: Mapping[str, Report], folders: Sequence[Path]) -> str:
    head = ("run", "guide", "steps", "pictures a step", "precision", "loss", "minutes", "parameters", "GMAC", "commit")
    rows = []
    for name, report in reports.items():
        training, net = report["training"], report["net"]
        settings = training.get("config", {}).get("train", {})
        weights = ", ".join(f"{term} {part['weight']:g}" for term, part in report["loss"].items() if _weighs(part))
        seconds, pairs = training.get("wall_seconds"), settings.get("pairs_per_batch")
        rows.append(
            (
                name,
                f"{report['guide']} ({len(report['guide_channels'])} channels)",
                f"{_planned_steps(report)}" + (f", the net of step {report['steps']}" if _is_best(report) else ""),
                "" if pairs is None else f"{2 * pairs}",
                settings.get("precision", ""),
                weights,
                "not recorded" if seconds is None else f"{seconds / 60.0:.0f}",
                f"{net['parameters']:,}",
                f"{net['gmac']:.3g}",
                training["provenance"]["commit"],
            )
        )
    commands = [
        f"python -m sixway.train {folder}/config.yaml --run-dir {folder}\n"
        f"python -m sixway.evaluate {folder}{' --best' if _is_best(reports[folder.name]) else ''}"
        for folder in folders
    ]
    first = next(iter(reports.values()))
    same = {report["dataset_sha256"] for report in reports.values()}
    hardware = {report["training"]["provenance"]["hardware"] for report in reports.values()}
    note = (
        f"Dataset {first['dataset']}, manifest {first['dataset_sha256'][:12]}"
        f"{'' if len(same) == 1 else ' (the others were scored on OTHER data)'}. "
        f"Hardware: {'; '.join(sorted(hardware))}. Evaluated at commit {first['provenance']['commit']}, this page "
        f"written at {provenance()['commit']}. Minutes are wall time between the first and the last file of a run; "
        "pauses and other work on the machine count. GMAC: multiply-adds of one picture of the headline's size."
    )
    table = Table(title="Runs", head=head, rows=tuple(rows))
    return f"{table.markdown()}\n\n{note}\n\n```bash\n" + "\n".join(commands) + "\n```"


def _planned_steps(report: Report) -> int:
    """Steps of the whole run; those of the net where that is not recorded."""
    steps: int = report["training"].get("config", {}).get("train", {}).get("steps", report["steps"])
    return steps


def _is_best(report: Report) -> bool:
    """Whether the net is that of the best validation, before the last step."""
    return bool(report["steps"] < _planned_steps(report))


def _weighs(part: Any) -> bool:
    return isinstance(part, Mapping) and bool(part.get("weight"))


def _shown(table: Table) -> str:
    note = f"{table.note}\n\n" if table.note else ""
    return f"## {table.title}\n\n{note}{table.markdown() if table.rows else 'Not measured.'}"


def _ablation(folder: Path | None) -> str:
    """Every variant of scripts/ablate.py: mean over seeds, and the least and the greatest."""
    title = "## Ablation\n\n"
    found = (
        {}
        if folder is None
        else {path: read_json(path) for path in sorted(folder.glob("*/seed*/report_test/report.json"))}
    )
    if not found:
        return title + "Not run: `python scripts/ablate.py configs/train/cpu.yaml --steps N`."
    trials: dict[str, list[Report]] = {}
    for path, report in found.items():
        trials.setdefault(path.parents[2].name, []).append(report)
    variants = sorted(trials, key=lambda name: (name != "full", name))
    full = [_mean_psnr(report) for report in trials.get("full", [])]
    rows = []
    for name in variants:
        nets = [report["methods"]["net"] for report in trials[name]]
        own = [_mean_psnr(report) for report in trials[name]]
        perceived = [net["perceived"] for net in nets]
        apart = f"{statistics.mean(own) - statistics.mean(full):+.2f}" if full and name != "full" else ""
        rows.append(
            (
                name.replace("_", " "),
                str(len(nets)),
                _spread(own, 2),
                apart,
                _spread([net["psnr"]["maps_masked"]["mean_of_psnr_db"] for net in nets], 2),
                _spread([net["psnr"]["shaded"]["mean_of_psnr_db"] for net in nets], 2),
                *(_spread([p[key] for p in perceived if key in p], 4) for key in ("maps_ssim", "maps_flip")),
                _spread([net["flicker_ratio"] for net in nets if net["flicker_ratio"] is not None], 3),
                _spread([p["flicker_of_error"] for p in perceived if "flicker_of_error" in p], 5),
            )
        )
    head = ("variant", "seeds", "six maps [dB]", "to full", "smoke alone", "shaded", "SSIM", "FLIP")
    table = Table(title="", head=(*head, "flicker ratio", "flicker of the error"), rows=tuple(rows))
    steps = sorted({report["steps"] for report in found.values()})
    guides = sorted({report["guide"] for report in found.values()})
    note = (
        f"{', '.join(map(str, steps))} steps each, guide {', '.join(guides)}; mean over seeds (least to greatest), of "
        "the mean of the frames' PSNR. Differences smaller than the spread say nothing. Flicker as under Time: the row "
        "without the flow loss shows what that loss does for it."
    )
    return f"{title}{note}\n\n{table.markdown()}"


def _mean_psnr(report: Report) -> float:
    value: float = report["methods"]["net"]["psnr"]["maps"]["mean_of_psnr_db"]
    return value


def _spread(values: Sequence[float], digits: int) -> str:
    if not values:
        return ""
    mean = f"{statistics.mean(values):.{digits}f}"
    return mean if len(values) == 1 else f"{mean} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def _measured(path: Path | None, how: str, images: Path) -> str:
    """The rows of a script that measures, as a table."""
    if path is None:
        return f"Not run: `{how}`."
    found = read_json(path)
    rows = found["rows"]
    names = [row["name"] for row in rows]
    if rows and all("/" in name for name in names):
        table = _by_column(rows, _variant_and_quantity)
    elif len(set(names)) < len(names):  # the same thing in several units
        table = _by_column(rows, lambda row: (row["name"], row["unit"]))
    else:
        table = _row_by_row(rows)
    about = f"`{how}`; commit {found['commit']}, {found['hardware']}, {found['seconds']:.0f} s."
    picture = ""
    if path.with_suffix(".png").is_file():
        name = f"results_{path.stem}.png"
        _copy_small(path.with_suffix(".png"), images / name)
        picture = f"\n\n![{path.stem}](images/{name})"
    return f"{about}{picture}\n\n{table.markdown()}"


def _row_by_row(rows: Sequence[Mapping[str, Any]]) -> Table:
    lines = tuple(
        (row["name"], _number(row["value"]), row["unit"], row["bound"], "" if row["ok"] else "MISSED") for row in rows
    )
    return Table(title="", head=("", "value", "unit", "bound", ""), rows=lines)


def _variant_and_quantity(row: Mapping[str, Any]) -> tuple[str, str]:
    """Of a row named variant/quantity, and the unit with the latter."""
    variant, quantity = row["name"].split("/", 1)
    quantity = quantity.removesuffix(f"_{row['unit'].lower()}").replace("_", " ")
    return variant, f"{quantity} [{row['unit']}]"


def _by_column(rows: Sequence[Mapping[str, Any]], line_and_column: Callable[..., tuple[str, str]]) -> Table:
    """Rows of a script put together to lines with several columns."""
    values: dict[str, dict[str, str]] = {}
    for row in rows:
        line, column = line_and_column(row)
        values.setdefault(line, {})[column] = _number(row["value"]) + ("" if row["ok"] else f" MISSED ({row['bound']})")
    columns = list(dict.fromkeys(column for cells in values.values() for column in cells))
    lines = tuple((name, *(cells.get(column, "") for column in columns)) for name, cells in values.items())
    return Table(title="", head=("", *columns), rows=lines)


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.4g}"


def _pictures(run: Path, report: Report, images: Path) -> str:
    parts = ["## Pictures", f"Of {run.name}; the worst frame of the headline first, then medians."]
    for file, title in report["pictures"].items():
        name = f"results_{file}"
        _copy_small(run / "report_test" / file, images / name)
        parts.append(f"{title[:1].upper()}{title[1:]}.\n\n![{title}](images/{name})")
    return "\n\n".join(parts)


def _copy_small(source: Path, target: Path) -> None:
    """A PNG with a palette of 256 colours: a quarter of the bytes, and nobody sees it."""
    with Image.open(source) as image, atomic_path(target) as temporary:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(temporary, format="PNG", optimize=True)


if __name__ == "__main__":
    sys.exit(main())
