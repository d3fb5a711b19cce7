"""Small line charts as PNG, drawn with Pillow: what the validation pages show.

Curves are drawn one above the other, each thinner than the one before, so that equal ones all show, and
under the points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sixway.core.store import atomic_path

COLOURS = ("#1f6fb4", "#d1495b", "#2e8b57", "#8a5fbf", "#c98a1b", "#3a3a3a")
_INK, _GRID = "#222222", "#dddddd"
_OVERSAMPLING = 2
_MARGIN_LEFT, _MARGIN_RIGHT, _MARGIN_TOP, _MARGIN_BOTTOM = 52, 12, 26, 34


@dataclass(frozen=True, kw_only=True)
class Series:
    """One curve, or, with `marks`, points that no line joins."""

    label: str
    x: np.ndarray
    y: np.ndarray
    marks: bool = False


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One chart: title, names of its axes, curves. The legend stands in the `legend` corner."""

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    legend: str = "top left"


def write_charts(path: Path, panels: Sequence[Panel], *, width_px: int = 420, height_px: int = 320) -> None:
    """Panels side by side."""
    scale = _OVERSAMPLING
    sheet = Image.new("RGB", (len(panels) * width_px * scale, height_px * scale), "white")
    for number, panel in enumerate(panels):
        sheet.paste(_drawn(panel, width_px * scale, height_px * scale), (number * width_px * scale, 0))
    sheet = sheet.resize((len(panels) * width_px, height_px), Image.Resampling.LANCZOS)
    with atomic_path(path) as temporary:
        sheet.save(temporary, optimize=True)


def _drawn(panel: Panel, width: int, height: int) -> Image.Image:
    s = _OVERSAMPLING
    image = Image.new("RGB", (width, height), "white")
    draw = ImageDraw.Draw(image)
    font, small = ImageFont.load_default(13 * s), ImageFont.load_default(11 * s)
    left, right, top, bottom = _MARGIN_LEFT * s, width - _MARGIN_RIGHT * s, _MARGIN_TOP * s, height - _MARGIN_BOTTOM * s
    x_ticks = _ticks(np.concatenate([series.x for series in panel.series]))
    y_ticks = _ticks(np.concatenate([series.y for series in panel.series]))

    def place(x: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
        across = left + (right - left) * (np.asarray(x) - x_ticks[0]) / (x_ticks[-1] - x_ticks[0])
        up = bottom - (bottom - top) * (np.asarray(y) - y_ticks[0]) / (y_ticks[-1] - y_ticks[0])
        return list(zip(across.tolist(), up.tolist(), strict=True))

    for tick in x_ticks:
        ((at, _),) = place(np.array([tick]), y_ticks[:1])
        draw.line([(at, top), (at, bottom)], fill=_GRID, width=s)
        draw.text((at, bottom + 3 * s), f"{tick:g}", fill=_INK, font=small, anchor="mt")
    for tick in y_ticks:
        ((_, at),) = place(x_ticks[:1], np.array([tick]))
        draw.line([(left, at), (right, at)], fill=_GRID, width=s)
        draw.text((left - 4 * s, at), f"{tick:g}", fill=_INK, font=small, anchor="rm")
    coloured = list(enumerate(zip(panel.series, COLOURS, strict=False)))
    for number, (series, colour) in sorted(coloured, key=lambda item: item[1][0].marks):
        points = place(series.x, series.y)
        if series.marks:
            for x, y in points:
                draw.ellipse([x - 3 * s, y - 3 * s, x + 3 * s, y + 3 * s], outline=colour, width=s)
        else:
            draw.line(points, fill=colour, width=s * (len(panel.series) - number) + 1, joint="curve")
    _legend(draw, panel, small, (left, right, top, bottom))
    draw.text(((left + right) // 2, 6 * s), panel.title, fill=_INK, font=font, anchor="mt")
    draw.text((right, height - 3 * s), panel.x_label, fill=_INK, font=small, anchor="rb")
    draw.text((4 * s, 6 * s), panel.y_label, fill=_INK, font=small, anchor="lt")
    return image


def _legend(draw: ImageDraw.ImageDraw, panel: Panel, font: ImageFont.FreeTypeFont, box: tuple[int, ...]) -> None:
    s, line = _OVERSAMPLING, 14 * _OVERSAMPLING
    left, right, top, bottom = box
    wide = max(int(draw.textlength(series.label, font=font)) for series in panel.series) + 22 * s
    x = left + 6 * s if "left" in panel.legend else right - wide - 4 * s
    y = top + 6 * s if "top" in panel.legend else bottom - line * len(panel.series) - 4 * s
    draw.rectangle([x - 2 * s, y - 2 * s, x + wide, y + line * len(panel.series)], fill="white")
    for series, colour in zip(panel.series, COLOURS, strict=False):
        middle = y + line // 2
        if series.marks:
            draw.ellipse([x + 5 * s, middle - 3 * s, x + 11 * s, middle + 3 * s], outline=colour, width=s)
        else:
            draw.line([(x, middle), (x + 16 * s, middle)], fill=colour, width=2 * s)
        draw.text((x + 20 * s, middle), series.label, fill=_INK, font=font, anchor="lm")
        y += line


def _ticks(values: np.ndarray) -> np.ndarray:
    """Round numbers, four to eight of them, around all values."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    rough = max(high - low, 1e-12) / 5.0
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough)
    return step * np.arange(np.floor(low / step + 1e-9), np.ceil(high / step - 1e-9) + 1)
