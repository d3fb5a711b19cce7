"""report.json for programs and report.html for people: one file, pictures inside, no script."""

import base64
from pathlib import Path
from typing import Any

from jinja2 import Environment

from sixway.core.store import write_json, write_text
from sixway.evaluation.tables import Table, axis_tables, fire_table, main_table, map_table, time_table

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
            f"Maps: sRGB with the dataset's brightness scale. {sparse(report)}"
        ),
        tables=report_tables(report),
        pictures=embedded,
        texts={
            "The net": _lines(report["net"]),
            "What it was trained under": _lines(report["loss"]),
            "Provenance": _lines(report["provenance"]),
        },
    )
    write_text(folder / "report.html", page)
    return folder / "report.html"


def report_tables(report: dict[str, Any]) -> list[Table]:
    """All tables of one report, the most important first."""
    one = {"run": report}
    fire = fire_table(one)
    return [main_table(one), map_table(one), *axis_tables(one), *([fire] if fire else []), time_table(one)]


def sparse(report: dict[str, Any]) -> str:
    """How many of the frames are nearly empty."""
    part = next((row for row in report["breakdown"]["coverage"] if row["label"].startswith("less than")), None)
    frames = 0 if part is None else part["frames"]
    return f"{frames} of them show smoke on less than {report['sparse_below']:.0%} of their pixels; they count as well."


def _lines(values: dict[str, Any]) -> str:
    return "\n".join(f"{key}: {value}" for key, value in values.items())
