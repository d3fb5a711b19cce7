"""The tables of one report or of several side by side, as text: for the page, the results and the notebook.

Reports are what `compare` wrote, by the name of their run; with one report alone its name is left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sixway.core.conventions import DIRECTIONS

Reports = Mapping[str, Mapping[str, Any]]

BOTH = "PSNR in dB: mean over frames (PSNR of the mean squared error)."


@dataclass(frozen=True, kw_only=True)
class Table:
    """rows: one text for every entry of `head`. note: what a reader must know, may be empty."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def markdown(self) -> str:
        """The table alone, without title and note."""
        lines = [self.head, tuple("---" for _ in self.head), *self.rows]
        return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def db(value: float | None) -> str:
    """A PSNR; None is how reports write infinity."""
    return "inf" if value is None else f"{value:.2f}"


def both(psnr: Mapping[str, Any]) -> str:
    """Both averages of a summary."""
    if psnr["frames"] == psnr["empty"]:
        return "no frame"
    return f"{db(psnr['mean_of_psnr_db'])} ({db(psnr['psnr_of_mean_mse_db'])})"


def main_table(reports: Reports) -> Table:
    """Every metric of the headline frames, methods below one another, the ceiling last."""
    head = ("", "six maps", "max / min", "MSE", "smoke alone", "shaded", "shaded, smoke", "alpha", "SSIM maps / shaded")
    rows = []
    for label, _, summary in _methods(reports):
        psnr, perceived = summary["psnr"], summary["perceived"]
        maps = psnr["maps"]
        rows.append(
            (
                label,
                both(maps),
                f"{db(maps['highest_db'])} / {db(maps['lowest_db'])}",
                f"{maps['mse']:.6f}",
                *(both(psnr[kind]) for kind in ("maps_masked", "shaded", "shaded_masked", "alpha")),
                _pair(perceived, "ssim"),
                _pair(perceived, "flip"),
                str(summary["frames"]),
            )
        )
    for label, report in _named(reports, "ceiling (noise of the references)"):
        rows.append((label, db(report["ceiling_psnr_db"]) if report["ceiling_psnr_db"] else "not measured", *[""] * 9))
    return Table(
        title="PSNR, MSE, SSIM and FLIP",
        head=(*head, "FLIP maps / shaded", "frames"),
        rows=tuple(rows),
        note=f"{BOTH} {_about(reports)}",
    )


def map_table(reports: Reports) -> Table:
    """Each of the six maps."""
    rows = [
        (label, *(both(summary["per_map"][name]) for name in DIRECTIONS)) for label, _, summary in _methods(reports)
    ]
    for label, _, summary in _nets(reports):
        maps = summary["per_map"]
        rows.append((f"{label}, smoke alone", *(both(maps[name]["masked"]) for name in DIRECTIONS)))
        rows.append((f"{label}, MSE", *(f"{maps[name]['mse']:.6f}" for name in DIRECTIONS)))
        if all(maps[name]["flip"] is not None for name in DIRECTIONS):
            rows.append((f"{label}, SSIM", *(f"{maps[name]['ssim']:.4f}" for name in DIRECTIONS)))
            rows.append((f"{label}, FLIP", *(f"{maps[name]['flip']:.4f}" for name in DIRECTIONS)))
    return Table(title="Map by map", head=("", *DIRECTIONS), rows=tuple(rows), note=BOTH)


def axis_table(reports: Reports, axis: str, *, title: str, note: str) -> Table:
    """One axis of the breakdown: its conditions downwards, the six maps of every method across."""
    single = len(reports) == 1
    labels = list(dict.fromkeys(row["label"] for report in reports.values() for row in report["breakdown"][axis]))
    head, columns = ["", "frames", "coverage"], []
    for name, report in reports.items():
        rows = {row["label"]: row for row in report["breakdown"][axis]}
        prefix = "" if single else f"{name}: "
        head += [prefix + method for method in report["methods"]] + [f"{prefix}net, shaded"]
        columns.append([_across(rows.get(label), list(report["methods"])) for label in labels])
        if any("apart_db" in row for row in rows.values()):
            head.append(f"{prefix}net, apart")
            columns.append([_apart(rows.get(label)) for label in labels])
    first = {row["label"]: row for report in reports.values() for row in report["breakdown"][axis]}
    rows_out = []
    for i, label in enumerate(labels):
        cells = [cell for column in columns for cell in column[i]]
        rows_out.append((label, str(first[label]["frames"]), f"{first[label]['coverage']:.1%}", *cells))
    return Table(title=title, head=tuple(head), rows=tuple(rows_out), note=note)


def _across(row: Mapping[str, Any] | None, methods: list[str]) -> list[str]:
    """Both averages of the six maps by every method, then the net's shaded score."""
    found = {} if row is None else row["methods"]
    picked = [(method, "maps") for method in methods] + [("net", "shaded")]
    return [both(found[method]["psnr"][kind]) if method in found else "" for method, kind in picked]


def _apart(row: Mapping[str, Any] | None) -> list[str]:
    value = None if row is None else row["apart_db"]
    return ["" if value is None else f"{value:+.2f}"]


def axis_tables(reports: Reports) -> list[Table]:
    """Simulations, cameras, image sizes, densities, and how the frames with hardly any smoke fare."""
    return [
        axis_table(reports, "simulation", title="By simulation", note=f"The six maps. {BOTH}"),
        axis_table(reports, "view", title="By camera", note="The six maps, headline size and density."),
        axis_table(
            reports,
            "size",
            title="By image size",
            note="The six maps. Apart: mean PSNR minus that of the headline, same moments and cameras.",
        ),
        axis_table(
            reports,
            "density",
            title="By density",
            note="The six maps; the smoke of the simulation made so many times as dense. Apart: as above.",
        ),
        axis_table(
            reports,
            "coverage",
            title="With and without frames that show hardly any smoke",
            note="All sizes and densities.",
        ),
    ]


def fire_table(reports: Reports) -> Table | None:
    """Emissive, over the frames that burn; None where none does."""
    rows = [
        (label, both(summary["emissive"]), f"{summary['emissive']['mse']:.6f}", str(summary["emissive"]["frames"]))
        for label, _, summary in _methods(reports)
        if summary["emissive"] is not None
    ]
    if not rows:
        return None
    head = ("", "PSNR", "MSE", "burning frames")
    return Table(title="Fire", head=head, rows=tuple(rows), note=f"Emissive, sRGB-encoded, full frame. {BOTH}")


def time_table(reports: Reports) -> Table:
    """Flicker: what changes between two frames beyond the motion of the smoke, in sRGB of the six maps."""
    rows = []
    for label, _, summary in _methods(reports):
        values = summary["perceived"]
        if "temporal_error" in values:
            keys = ("temporal_error", "temporal_error_of_truth", "flicker_of_error")
            rows.append((label, *(f"{values[key]:.5f}" for key in keys), f"{summary['flicker_ratio']:.3f}"))
    return Table(
        title="Time",
        head=("", "temporal error", "of the references", "flicker of the error", "ratio of the first two"),
        rows=tuple(rows),
        note="Mean absolute difference of a frame and the one before, moved by the simulator's motion, over the smoke. "
        "The references change by themselves: a ratio of 1 is as calm as they are, below 1 is blurred. Flicker of the "
        "error: the same of (answer - reference); 0 is perfect.",
    )


def _methods(reports: Reports) -> list[tuple[str, Mapping[str, Any], Mapping[str, Any]]]:
    """Label, report and summary of every method, nets first."""
    single = len(reports) == 1
    found = [
        (method if single else f"{name}: {method}", report, summary)
        for name, report in reports.items()
        for method, summary in report["methods"].items()
    ]
    return sorted(found, key=_is_floor)


def _nets(reports: Reports) -> list[tuple[str, Mapping[str, Any], Mapping[str, Any]]]:
    return [row for row in _methods(reports) if not _is_floor(row)]


def _is_floor(row: tuple[str, Mapping[str, Any], Mapping[str, Any]]) -> bool:
    return row[2] is not row[1]["methods"]["net"]


def _named(reports: Reports, what: str) -> list[tuple[str, Mapping[str, Any]]]:
    return [(what if len(reports) == 1 else f"{name}: {what}", report) for name, report in reports.items()]


def _pair(perceived: Mapping[str, float], metric: str) -> str:
    keys = (f"maps_{metric}", f"shaded_{metric}")
    return " / ".join(f"{perceived[key]:.4f}" for key in keys) if all(key in perceived for key in keys) else ""


def _about(reports: Reports) -> str:
    """What the headline frames are."""
    report = next(iter(reports.values()))
    quoted, every = report["headline"], report["perceived"]["every"]
    return (
        f"{quoted['frames']} frames of the {report['split']} split ({', '.join(quoted['simulations'])}), "
        f"{quoted['width_px']} x {quoted['height_px']}, density x{quoted['density_scale']:g}; other sizes and "
        f"densities below. Smoke alone: true alpha above {report['mask_alpha']}, {report['coverage']:.1%} of all "
        f"pixels. Shaded: {len(report['lights'])} fixed white lights, one at a time, without fire. SSIM and "
        f"FLIP: the first frame of one pair in {every}; shaded, under {len(report['perceived']['lights'])} of these. "
        "The ceiling is what a perfect net would score: two references that differ in their seed, + 3.01 dB (bias "
        "apart). The billboard is scored where the camera is not the one it was baked for."
    )
