"""report.json for programs and report.html for people: one file, pictures inside, no script."""

import base64
from pathlib import Path
from typing import Any

from jinja2 import Environment

from sixway.core.store import write_json, write_text

_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>sixway: {{ title }}</title>
<style>
 body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem; padding: 0 1rem; color: #1b1e23 }
 table { border-collapse: collapse; margin: 1rem 0 } th, td { padding: .25rem .8rem; text-align: right }
 th:first-child, td:first-child { text-align: left } tr:nth-child(even) { background: #f2f4f7 }
 img { max-width: 100%; image-rendering: pixelated } .note { color: #5a6270 } pre { background: #f2f4f7; padding: 1rem }
</style>
<h1>{{ title }}</h1>
<p class="note">{{ about }}</p>
{% for table in tables %}<h2>{{ table.title }}</h2>
<table><tr>{% for cell in table.head %}<th>{{ cell }}</th>{% endfor %}</tr>
{% for row in table.rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</table>
{% if table.note %}<p class="note">{{ table.note }}</p>{% endif %}{% endfor %}
{% for picture in pictures %}<h2>{{ picture.title }}</h2>
<img alt="{{ picture.title }}" src="{{ picture.data }}">{% endfor %}
{% for title, text in texts.items() %}<h2>{{ title }}</h2><pre>{{ text }}</pre>{% endfor %}
</html>
"""


def write_report(folder: Path, report: dict[str, Any], pictures: dict[str, Path]) -> Path:
    """Write both reports into `folder`; the path of the page. pictures: PNG files by title."""
    write_json(folder / "report.json", report)
    environment = Environment(autoescape=True)
    embedded = [
        {"title": title, "data": "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()}
        for title, path in pictures.items()
    ]
    page = environment.from_string(_PAGE).render(
        title=f"{report['dataset']}, {report['split']} split, guide {report['guide']}",
        about=(
            f"{report['frames']} frames; commit {report['provenance']['commit']}; {report['provenance']['hardware']}. "
            "Maps: sRGB with the dataset's brightness scale. Shaded: four fixed light sets, sRGB, clipped to [0, 1]. "
            f"Masked: true alpha above {report['mask_alpha']}, {report['coverage']:.1%} of the pixels."
        ),
        tables=[_psnr_table(report), _map_table(report), _perceived_table(report)],
        pictures=embedded,
        texts={"What the net was trained under": _lines(report["loss"]), "Provenance": _lines(report["provenance"])},
    )
    write_text(folder / "report.html", page)
    return folder / "report.html"


def _db(value: float | None) -> str:
    return "inf" if value is None else f"{value:.2f}"


def _psnr_table(report: dict[str, Any]) -> dict[str, Any]:
    rows = []
    for name, summary in report["methods"].items():
        maps, masked, shaded = (summary["psnr"][kind] for kind in ("maps", "maps_masked", "shaded"))
        rows.append(
            [
                name,
                _db(maps["psnr_of_mean_mse_db"]),
                _db(maps["mean_of_psnr_db"]),
                f"{_db(maps['highest_db'])} / {_db(maps['lowest_db'])}",
                f"{maps['mse']:.5f}",
                _db(masked["psnr_of_mean_mse_db"]),
                _db(shaded["psnr_of_mean_mse_db"]),
                _db(summary["psnr"]["alpha"]["psnr_of_mean_mse_db"]),
                summary["worst_simulation"],
            ]
        )
    ceiling = report["ceiling_psnr_db"]
    note = (
        "The references are noisy too: a perfect net would score about "
        f"{ceiling:.1f} dB on the maps (two seeds, + 3.01 dB, bias apart)."
        if ceiling is not None
        else "The noise of the references was not measured."
    )
    head = ["", "maps: PSNR of mean MSE", "mean of PSNRs", "max / min", "MSE", "masked", "shaded", "alpha", "worst"]
    return {"title": "PSNR in dB", "head": head, "rows": rows, "note": note}


def _map_table(report: dict[str, Any]) -> dict[str, Any]:
    names = list(next(iter(report["methods"].values()))["per_map_psnr_db"])
    rows = [[m, *(_db(s["per_map_psnr_db"][n]) for n in names)] for m, s in report["methods"].items()]
    return {"title": "Each map, PSNR of mean MSE in dB", "head": ["", *names], "rows": rows, "note": ""}


def _perceived_table(report: dict[str, Any]) -> dict[str, Any]:
    perceived = report["methods"]["net"]["perceived"]
    rows = [[name.replace("_", " "), f"{value:.4f}"] for name, value in perceived.items()]
    note = "Temporal error: what is left of a frame after warping the one before; the truth has some of its own."
    return {"title": "The net, as perceived", "head": ["", "mean"], "rows": rows, "note": note}


def _lines(values: dict[str, Any]) -> str:
    return "\n".join(f"{key}: {value}" for key, value in values.items())
