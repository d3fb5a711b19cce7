"""Pictures of a report: contact sheets (guide, maps predicted, true and their FLIP, relit) and sheets of all lights."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from sixway.baselines.encoding import encode_target
from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.png import to_8bit, write_8bit_png
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Sample
from sixway.evaluation.lights import PICTURE_LIGHTS, SCORE_LIGHTS
from sixway.evaluation.score import Answers, as_lightmap, shaded
from sixway.metrics.flip import flip_picture
from sixway.shading.compose import over, shade

_TILE_PX = 160
_LIGHT_TILE_PX = 96
_LABEL_PX = 16
_GUTTER_PX = 4
_PAPER = (24, 26, 30)
_SKY = np.array([0.05, 0.08, 0.13], np.float32)

Row = tuple[str, list[tuple[str, np.ndarray]]]
"""A title and labelled pictures [h, w, 1 or 3] in [0, 1], ready to display."""


def write_pictures(out: Path, dataset: SmokeDataset, net: Answers, frames: list[tuple[str, Sample]]) -> dict[str, Path]:
    """A contact sheet of every frame, and of all but the first one a sheet of the 16 lights; PNG files by title."""
    pictures = {}
    for number, (title, sample) in enumerate(frames):
        group = next(i for i, group in enumerate(dataset.groups) if sample in group.samples)
        row, second = divmod(dataset.groups[group].samples.index(sample), 2)
        pair = dataset.pair(group, row)
        guide = pair.guide.numpy()
        answer = net.answer(guide, dataset.groups[group].samples[2 * row : 2 * row + 2])
        assert answer is not None, "a net answers every frame"
        predicted, truth = np.maximum(answer[second], 0.0), encode_target(dataset, pair)[second]
        path = out / f"contact_sheet_{number}.png"
        contact_sheet(
            path,
            guide=guide[second],
            guide_channels=dataset.guide_channels,
            scale=dataset.scale,
            emissive_scale=dataset.emissive_scale,
            predicted=predicted,
            truth=truth,
            has_emissive=dataset.has_emissive,
        )
        pictures[f"{title}: {sample.simulation}, {sample.view}, frame {sample.frame}"] = path
        if number > 0:
            path = out / f"lights_{number}.png"
            light_sheet(path, predicted=predicted, truth=truth)
            pictures[f"{title} under the lights of the shaded scores"] = path
    return pictures


def contact_sheet(
    path: Path,
    *,
    guide: Float[np.ndarray, "g h w"],
    guide_channels: tuple[str, ...],
    scale: float,
    predicted: Float[np.ndarray, "8 h w"],
    truth: Float[np.ndarray, "8 h w"],
    emissive_scale: float | None = None,
    has_emissive: bool = False,
) -> None:
    """Write the sheet of one frame as a PNG. guide: raw; predicted, truth: encoded."""

    def encoded(name: str, values: np.ndarray) -> np.ndarray:
        if name in ("transmittance", "depth"):
            return values
        return encode_srgb(values * ((emissive_scale or scale) if name == "emissive" else scale))

    shown = [(name, encoded(name, guide[i])) for i, name in enumerate(guide_channels)]
    names = LIGHTMAP_CHANNELS if has_emissive else LIGHTMAP_CHANNELS[:-1]
    said = "six maps, alpha and emissive" if has_emissive else "six maps and alpha"
    rows: list[Row] = [
        ("guide (the net's input)", [(name, np.clip(image, 0, 1)[..., None]) for name, image in shown]),
        (f"{said}, predicted", [(name, _grey(predicted[i])) for i, name in enumerate(names)]),
        (f"{said}, path-traced", [(name, _grey(truth[i])) for i, name in enumerate(names)]),
        (
            "FLIP of the two (black = equal)",
            [
                (name, flip_picture(predicted=_grey(predicted[i]), reference=_grey(truth[i])))
                for i, name in enumerate(names)
            ],
        ),
        ("relit, predicted", _relit(predicted)),
        ("relit, path-traced", _relit(truth)),
    ]
    write_8bit_png(path, _compose(rows, _TILE_PX))


def light_sheet(path: Path, *, predicted: Float[np.ndarray, "8 h w"], truth: Float[np.ndarray, "8 h w"]) -> None:
    """Write the frame under each of the `SCORE_LIGHTS`, on black, as a PNG. Both: encoded."""
    pictures = [shaded(np.ascontiguousarray(np.moveaxis(x[: len(DIRECTIONS)], 0, -1))) for x in (predicted, truth)]
    labels = ["{:+.1f} {:+.1f} {:+.1f}".format(*light.to_light) for light in SCORE_LIGHTS]
    tiles = [[picture[..., i : i + 1] for i in range(len(labels))] for picture in pictures]
    flips = [flip_picture(predicted=p, reference=t) for p, t in zip(*tiles, strict=True)]
    rows: list[Row] = [
        (title, list(zip(labels, row, strict=True)))
        for title, row in (
            ("lit by one light (x right, y up, z to the viewer), predicted", tiles[0]),
            ("path-traced", tiles[1]),
            ("FLIP of the two (black = equal)", flips),
        )
    ]
    write_8bit_png(path, _compose(rows, _LIGHT_TILE_PX))


def _grey(channel: np.ndarray) -> np.ndarray:
    return np.clip(channel, 0.0, 1.0).astype(np.float32)[..., None]


def _relit(encoded: np.ndarray) -> list[tuple[str, np.ndarray]]:
    lightmap = as_lightmap(encoded)
    sky = np.broadcast_to(_SKY, (*encoded.shape[1:], 3))
    return [
        (name, np.clip(encode_srgb(over(shade(lightmap, lights), lightmap["alpha"], sky)), 0.0, 1.0))
        for name, lights in PICTURE_LIGHTS.items()
    ]


def _compose(rows: list[Row], tile_px: int) -> np.ndarray:
    columns = max(len(tiles) for _, tiles in rows)
    row_px = 2 * _LABEL_PX + tile_px + _GUTTER_PX
    sheet = Image.new("RGB", (columns * (tile_px + _GUTTER_PX) + _GUTTER_PX, len(rows) * row_px + _GUTTER_PX), _PAPER)
    draw = ImageDraw.Draw(sheet)
    title_font, label_font = ImageFont.load_default(14), ImageFont.load_default(11)
    for row, (title, tiles) in enumerate(rows):
        top = row * row_px + _GUTTER_PX
        draw.text((_GUTTER_PX, top), title, fill=(235, 235, 235), font=title_font)
        for column, (label, picture) in enumerate(tiles):
            left = column * (tile_px + _GUTTER_PX) + _GUTTER_PX
            draw.text((left, top + _LABEL_PX + 2), label, fill=(160, 165, 175), font=label_font)
            sheet.paste(_tile(picture, tile_px), (left, top + 2 * _LABEL_PX))
    return np.asarray(sheet)


def _tile(picture: np.ndarray, tile_px: int) -> Image.Image:
    pixels = to_8bit(picture.astype(np.float32))
    image = Image.fromarray(np.repeat(pixels, 3, axis=-1) if pixels.shape[-1] == 1 else pixels)
    width, height = image.size
    factor = tile_px / max(width, height)
    resampling = Image.Resampling.NEAREST if factor >= 1.0 else Image.Resampling.LANCZOS
    return image.resize((max(1, round(width * factor)), max(1, round(height * factor))), resampling)
