"""A contact sheet of lightmaps: frames below one another, maps side by side, ready for the eye."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS
from sixway.core.png import to_8bit
from sixway.shading.fire import ArtistRamp, BlackBodyRamp, fire_colour

_LABEL_PX = 18
_GUTTER_PX = 4
_PAPER, _INK = (24, 26, 30), (200, 205, 215)
_WHITE_PERCENTILE = 99.9

Maps = Mapping[str, Float[np.ndarray, "h w"]]
"""Channels of one frame by name, linear: directions, alpha, and what of its fire there is."""


def lightmap_sheet(
    frames: Sequence[tuple[str, Maps]], *, fire: BlackBodyRamp | ArtistRamp | None = None, tile_px: int = 144
) -> UInt8[np.ndarray, "sheet_h sheet_w 3"]:
    """The frames, each with its title, as 8-bit sRGB; alike channels of all frames share a column.

    One exposure, told in the sheet, puts the 99.9th percentile of all maps at white; emissive and self_lit have the
    same, and the colours of the ramp. Alpha is shown as it is. tile_px: longer side of a picture.
    """
    columns = list(frames[0][1])
    maps = [image for _, channels in frames for name, image in channels.items() if name in DIRECTIONS]
    white = float(np.percentile(maps, _WHITE_PERCENTILE))
    exposure = 1.0 / white if white > 0.0 else 1.0
    height, width = maps[0].shape
    factor = tile_px / max(height, width)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    step_x, step_y = size[0] + _GUTTER_PX, size[1] + _LABEL_PX + _GUTTER_PX
    sheet = Image.new("RGB", (len(columns) * step_x + _GUTTER_PX, len(frames) * step_y + 2 * _LABEL_PX), _PAPER)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(12)
    for column, name in enumerate(columns):
        draw.text((_GUTTER_PX + column * step_x, 2), name, fill=_INK, font=font)
    for row, (title, channels) in enumerate(frames):
        top = _LABEL_PX + row * step_y
        draw.text((_GUTTER_PX, top), title, fill=_INK, font=font)
        for column, name in enumerate(columns):
            picture = _shown(name, channels[name], exposure, fire or BlackBodyRamp())
            tile = Image.fromarray(to_8bit(picture)).resize(size, Image.Resampling.LANCZOS)
            sheet.paste(tile, (_GUTTER_PX + column * step_x, top + _LABEL_PX))
    last = _LABEL_PX + len(frames) * step_y
    draw.text((_GUTTER_PX, last), f"light x {exposure:.3g}, sRGB; alpha linear", fill=_INK, font=font)
    return np.asarray(sheet)


def _shown(
    name: str, image: Float[np.ndarray, "h w"], exposure: float, fire: BlackBodyRamp | ArtistRamp
) -> Float[np.ndarray, "h w 3"]:
    """One channel in [0, 1], encoded for display."""
    if name in ("emissive", "self_lit"):
        return np.clip(encode_srgb(fire_colour(image * np.float32(exposure), fire)), 0.0, 1.0)
    grey = image if name == "alpha" else encode_srgb(image * np.float32(exposure))
    return np.repeat(np.clip(grey, 0.0, 1.0)[..., None], 3, axis=-1)
