"""The contact sheet: guide, maps predicted, true and their FLIP, and the smoke relit, labelled."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.png import to_8bit, write_8bit_png
from sixway.evaluation.score import TEST_LIGHTS, as_lightmap
from sixway.metrics.flip import flip_picture
from sixway.shading.compose import over, shade

_TILE_PX = 160
_LABEL_PX = 16
_GUTTER_PX = 4
_PAPER = (24, 26, 30)
_SKY = np.array([0.05, 0.08, 0.13], np.float32)

Row = tuple[str, list[tuple[str, np.ndarray]]]
"""A title and labelled pictures [h, w, 1 or 3] in [0, 1], ready to display."""


def contact_sheet(
    path: Path,
    *,
    guide: np.ndarray,
    guide_channels: tuple[str, ...],
    scale: float,
    predicted: np.ndarray,
    truth: np.ndarray,
) -> None:
    """Write the sheet of one frame as a PNG. guide: [g, h, w] raw; predicted, truth: [8, h, w] encoded."""
    lit = len(DIRECTIONS)
    shown = [
        (name, guide[i] if name in ("transmittance", "depth") else encode_srgb(guide[i] * scale))
        for i, name in enumerate(guide_channels)
    ]
    rows: list[Row] = [
        ("guide (the net's input)", [(name, np.clip(image, 0, 1)[..., None]) for name, image in shown]),
        ("six maps and alpha, predicted", _maps(predicted)),
        ("six maps and alpha, path-traced", _maps(truth)),
        (
            "FLIP of the two (black = equal)",
            [
                (name, flip_picture(predicted=_grey(predicted[i]), reference=_grey(truth[i])))
                for i, name in enumerate(LIGHTMAP_CHANNELS[: lit + 1])
            ],
        ),
        ("relit, predicted", _relit(predicted)),
        ("relit, path-traced", _relit(truth)),
    ]
    write_8bit_png(path, _compose(rows))


def _grey(channel: np.ndarray) -> np.ndarray:
    return np.clip(channel, 0.0, 1.0).astype(np.float32)[..., None]


def _maps(encoded: np.ndarray) -> list[tuple[str, np.ndarray]]:
    return [(name, _grey(encoded[i])) for i, name in enumerate(LIGHTMAP_CHANNELS[: len(DIRECTIONS) + 1])]


def _relit(encoded: np.ndarray) -> list[tuple[str, np.ndarray]]:
    lightmap = as_lightmap(encoded)
    sky = np.broadcast_to(_SKY, (*encoded.shape[1:], 3))
    return [
        (name, np.clip(encode_srgb(over(shade(lightmap, lights), lightmap["alpha"], sky)), 0.0, 1.0))
        for name, lights in TEST_LIGHTS.items()
    ]


def _compose(rows: list[Row]) -> np.ndarray:
    columns = max(len(tiles) for _, tiles in rows)
    row_px = 2 * _LABEL_PX + _TILE_PX + _GUTTER_PX
    sheet = Image.new("RGB", (columns * (_TILE_PX + _GUTTER_PX) + _GUTTER_PX, len(rows) * row_px + _GUTTER_PX), _PAPER)
    draw = ImageDraw.Draw(sheet)
    title_font, label_font = ImageFont.load_default(14), ImageFont.load_default(11)
    for row, (title, tiles) in enumerate(rows):
        top = row * row_px + _GUTTER_PX
        draw.text((_GUTTER_PX, top), title, fill=(235, 235, 235), font=title_font)
        for column, (label, picture) in enumerate(tiles):
            left = column * (_TILE_PX + _GUTTER_PX) + _GUTTER_PX
            draw.text((left, top + _LABEL_PX + 2), label, fill=(160, 165, 175), font=label_font)
            sheet.paste(_tile(picture), (left, top + 2 * _LABEL_PX))
    return np.asarray(sheet)


def _tile(picture: np.ndarray) -> Image.Image:
    pixels = to_8bit(picture.astype(np.float32))
    image = Image.fromarray(np.repeat(pixels, 3, axis=-1) if pixels.shape[-1] == 1 else pixels)
    width, height = image.size
    factor = _TILE_PX / max(width, height)
    resampling = Image.Resampling.NEAREST if factor >= 1.0 else Image.Resampling.LANCZOS
    return image.resize((max(1, round(width * factor)), max(1, round(height * factor))), resampling)
