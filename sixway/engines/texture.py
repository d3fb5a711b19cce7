"""One door to texture files: PNG (8 and 16 bits), TGA, EXR (half floats) and DDS."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import OpenEXR
from jaxtyping import Float
from PIL import Image, UnidentifiedImageError

from sixway.core.png import to_8bit
from sixway.core.store import atomic_path
from sixway.engines.dds import read_dds, write_dds
from sixway.engines.packing import Texture, decode, encode
from sixway.engines.png16 import bit_depth, read_png16, write_png16

TextureFormat = Literal["png", "png16", "tga", "exr", "dds_rgba8", "dds_rgba16f", "dds_bc7"]
TEXTURE_FORMATS: tuple[str, ...] = get_args(TextureFormat)

LARGEST_PIXELS = 1 << 28
_LARGEST_SIDE_PX = 16384
_LARGEST_FILE_BYTES = 2 << 30
_LETTERS = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


def suffix_of(kind: TextureFormat) -> str:
    """The file suffix of a format, with its dot."""
    return f".{kind.partition('_')[0].replace('png16', 'png')}"


def is_float(kind: TextureFormat) -> bool:
    """Whether a format holds linear floats; the others hold code values in [0, 1]."""
    return kind in ("exr", "dds_rgba16f")


def write_texture(path: Path, slices: Float[np.ndarray, "n h w k"], texture: Texture, kind: TextureFormat) -> None:
    """Write linear values as one file, atomically. Several slices (an array) need a DDS format.

    Raises ValueError for what a format cannot hold: several slices outside DDS, NaN, or floats beyond half.
    """
    if len(slices) != 1 and not kind.startswith("dds"):
        raise ValueError(f"{path}: {kind} holds one slice a file, got {len(slices)}; use a DDS format")
    if is_float(kind) and not np.all(np.abs(slices) <= 65504.0):
        raise ValueError(f"{path}: values must be finite and at most 65504 to be stored as half floats")
    with atomic_path(path) as temporary:
        match kind:
            case "exr":
                _write_exr(temporary, slices[0])
            case "png16":
                write_png16(temporary, np.rint(encode(slices[0], texture) * 65535.0).astype(np.uint16))
            case "png" | "tga":
                pixels = to_8bit(encode(slices[0], texture))
                grey = pixels.shape[-1] == 1
                Image.fromarray(pixels[..., 0] if grey else pixels).save(temporary, format=kind.upper())
            case "dds_rgba16f":
                write_dds(temporary, _rgba(slices), "rgba16f", srgb=False)
            case "dds_rgba8" | "dds_bc7":
                coded = _rgba(np.stack([to_8bit(encode(one, texture)) for one in slices]), one=255)
                write_dds(temporary, coded, "bc7" if kind == "dds_bc7" else "rgba8", srgb=texture.rgb == "srgb")


def _rgba(slices: np.ndarray, one: int = 1) -> np.ndarray:
    """Grey in all three colours, and an opaque A where the texture has none."""
    if slices.shape[-1] == 4:
        return slices
    colour = slices.repeat(3, axis=-1) if slices.shape[-1] == 1 else slices
    return np.concatenate([colour, np.full_like(colour[..., :1], one)], axis=-1)


def _write_exr(path: Path, picture: Float[np.ndarray, "h w k"]) -> None:
    half = picture.astype(np.float16)
    planes = {name: np.ascontiguousarray(half[..., i]) for i, name in enumerate(_LETTERS[half.shape[-1]])}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, planes) as file:
        file.write(str(path))


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A texture file as it is stored. values: [n, h, w, k] float32; code values in [0, 1] unless `linear`.

    levels: how many values a channel can hold (256, 65536), 0 for floats.
    """

    values: Float[np.ndarray, "n h w k"]
    levels: int

    @property
    def linear(self) -> bool:
        return self.levels == 0


def read_picture(path: Path) -> Picture:
    """Read a PNG, TGA, EXR or DDS as it is stored, no curve undone.

    Raises FileNotFoundError, and ValueError with the remedy for what is damaged, too large, a palette PNG, or
    of a kind that is not read.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such texture")
    if path.stat().st_size > _LARGEST_FILE_BYTES:
        raise ValueError(f"{path}: larger than {_LARGEST_FILE_BYTES} bytes; split the flipbook")
    match path.suffix.lower():
        case ".exr":
            return Picture(values=_read_exr(path)[None], levels=0)
        case ".dds":
            stored = read_dds(path, largest_pixels=LARGEST_PIXELS)
            if stored.dtype == np.uint8:
                return Picture(values=stored.astype(np.float32) / 255.0, levels=256)
            return Picture(values=_finite(stored, path), levels=0)
        case ".png" if bit_depth(path) == 16:
            pixels = read_png16(path, largest_pixels=LARGEST_PIXELS)
            return Picture(values=pixels.astype(np.float32)[None] / 65535.0, levels=65536)
        case ".png" | ".tga":
            return Picture(values=_read_8bit(path).astype(np.float32)[None] / 255.0, levels=256)
        case other:
            raise ValueError(f"{path}: cannot read {other or 'a file without a suffix'}; give .png, .tga, .exr or .dds")


def read_texture(path: Path, texture: Texture) -> Float[np.ndarray, "n h w k"]:
    """Read a file of a known texture as linear values. Raises ValueError where its channels do not fit."""
    picture = read_picture(path)
    count = len(texture.channels)
    values = picture.values
    if path.suffix.lower() == ".dds":
        values = values[..., :count]  # DDS files hold RGBA always
    if values.shape[-1] != count:
        raise ValueError(
            f"{path}: holds {values.shape[-1]} channels, texture {texture.suffix} has {count} "
            f"({', '.join(texture.channels)}); export it as {'grey' if count == 1 else 'RGBA'[:count]}"
        )
    return values if picture.linear else decode(values, texture)


def _read_8bit(path: Path) -> np.ndarray:
    try:
        with Image.open(path) as image:
            if image.width * image.height > LARGEST_PIXELS or max(image.size) > _LARGEST_SIDE_PX:
                raise ValueError(f"{path}: {image.width} x {image.height} px is over the limit; split the flipbook")
            if image.mode not in ("L", "RGB", "RGBA"):
                raise ValueError(
                    f"{path}: pixels of kind {image.mode!r} (palette or other); save it as 8-bit grey, RGB or RGBA"
                )
            pixels = np.array(image)
    except (UnidentifiedImageError, OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path}: no readable picture ({error}); export it again") from error
    return pixels[..., None] if pixels.ndim == 2 else pixels


def _read_exr(path: Path) -> Float[np.ndarray, "h w k"]:
    OpenEXR.setMaxImageSize(_LARGEST_SIDE_PX, _LARGEST_SIDE_PX)  # a forged header may ask for any memory
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            planes = {name: plane.pixels for name, plane in file.channels().items()} if file.parts else {}
    except Exception as error:  # OpenEXR raises bare RuntimeError and others on junk
        raise ValueError(f"{path}: not a readable EXR file ({error}); export it again") from error
    letters = next((names for names in sorted(_LETTERS.values(), key=len)[::-1] if set(names) <= set(planes)), None)
    if letters is None:
        held = ", ".join(sorted(planes)) or "none that can be decoded: the file is truncated"
        raise ValueError(f"{path}: no channels R, G, B, A (it holds {held}); give a texture, not a layered render")
    return _finite(np.stack([planes[name].astype(np.float32) for name in letters], axis=-1), path)


def _finite(values: np.ndarray, path: Path) -> np.ndarray:
    if not np.isfinite(values).all():
        raise ValueError(f"{path}: holds NaN or infinite values; export it again")
    return values
