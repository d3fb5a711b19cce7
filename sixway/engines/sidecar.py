"""The JSON beside a flipbook: everything that a reader must know and pixels cannot say."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from sixway.core.config import Config, parse_config
from sixway.core.store import inside, read_json, write_json
from sixway.engines.flipbook import TileGrid
from sixway.engines.motion import MOTION_CHANNELS, Upwards
from sixway.engines.packing import AlphaMode, Packing, Texture, Transfer

_LARGEST_BYTES = 1 << 20

UNITS = (
    "maps: M = pi L / E, linear; a white Lambertian facing the light reads 1. The name of a map says where its light "
    "comes from: back = from behind the smoke, front = from the viewer's side."
)
ALPHA_MEANING = "alpha = 1 - transmittance, stored linear in every file; premultiplied maps are light on black"
TRANSFER_MEANING = (
    "files of whole numbers store R, G, B with the curve named here and A always linear; EXR and RGBA16F are linear"
)

MOTION_MEANING = (
    "stored = 0.5 + 0.5 v / scale, linear, 0.5 is no motion; v is the motion until the next shown frame, x in tile "
    "widths to the right, y in tile heights the way it says. Show frame A at uv - t v_A and the next, B, at "
    "uv + (1 - t) v_B, mixed 1 - t to t"
)


class TextureEntry(Config):
    """One texture: what R, G, B, A hold and the curve of each in files of whole numbers."""

    suffix: str = Field(max_length=32)
    channels: list[str] = Field(min_length=1, max_length=4)
    transfer: list[Transfer]


class FileEntry(Config):
    """One file. textures: numbers of the textures in it, from top to bottom. slice: which one of an array, if apart."""

    name: str = Field(max_length=255)
    sha256: str = Field(pattern="^[0-9a-f]{64}$")
    textures: list[int] = Field(min_length=1, max_length=16)
    slice: int | None = Field(default=None, ge=0)


class GridEntry(Config):
    """columns x rows tiles, row by row from the top left."""

    columns: int = Field(ge=1, le=256)
    rows: int = Field(ge=1, le=256)


class MotionEntry(Config):
    """Motion vectors. scale: tile widths and heights a shown frame that a stored 1 stands for. y: where + points."""

    scale: float = Field(gt=0.0, le=1e6)
    y: Upwards
    meaning: str = MOTION_MEANING


class Sidecar(Config):
    """What a flipbook holds. grid is None for an array of slices. tile_px: (width, height).

    Stored maps are `brightness` times M, stored emissive `emissive_brightness` times the emission integral. motion is
    None where there are no vectors, even if the packing has a place for them.
    """

    format: Literal["sixway-flipbook"] = "sixway-flipbook"
    version: Literal[1] = 1
    packing: str = Field(max_length=64)
    layout: Literal["grid", "array"]
    grid: GridEntry | None
    tile_px: tuple[int, int]
    frames: int = Field(ge=1, le=65536)
    fps: float = Field(gt=0.0, le=1000.0)
    loop: bool
    alpha: AlphaMode
    brightness: float = Field(gt=0.0, le=1e6)
    emissive_brightness: float = Field(gt=0.0, le=1e6)
    border_px: int = Field(default=0, ge=0)
    motion: MotionEntry | None = None
    textures: list[TextureEntry] = Field(min_length=1, max_length=16)
    files: list[FileEntry] = Field(min_length=1, max_length=65536)
    units: str = UNITS
    alpha_meaning: str = ALPHA_MEANING
    transfer_meaning: str = TRANSFER_MEANING

    @property
    def tile_grid(self) -> TileGrid | None:
        """The grid, or None for an array."""
        return TileGrid(self.grid.columns, self.grid.rows) if self.grid else None

    def packing_of(self) -> Packing:
        """The packing that this file describes: what it says, not what its name promises. Raises ValueError."""
        textures = tuple(
            Texture(suffix=t.suffix, channels=tuple(t.channels), rgb=t.transfer[0] if t.transfer else "srgb")
            for t in self.textures
        )
        stacked = any(len(file.textures) > 1 for file in self.files)
        return Packing(name=self.packing, textures=textures, source="sidecar", stacked=stacked)


def texture_entry(texture: Texture) -> TextureEntry:
    """A texture as the sidecar tells it."""
    curves = [texture.transfer(i) for i in range(len(texture.channels))]
    return TextureEntry(suffix=texture.suffix, channels=list(texture.channels), transfer=curves)


def write_sidecar(path: Path, sidecar: Sidecar) -> None:
    """Write it atomically."""
    write_json(path, sidecar.model_dump(mode="json"))


def read_sidecar(path: Path) -> Sidecar:
    """Read and check a sidecar. Raises FileNotFoundError, and ValueError for anything that it must not say."""
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: there is no sidecar; give the .json that python -m sixway.pack wrote beside the textures"
        )
    if path.suffix.lower() != ".json":
        raise ValueError(f"{path}: no sidecar; give the .json that python -m sixway.pack wrote beside the textures")
    if path.stat().st_size > _LARGEST_BYTES:
        raise ValueError(f"{path}: larger than {_LARGEST_BYTES} bytes; this is no sidecar")
    tree = read_json(path)
    if not isinstance(tree, dict):
        raise ValueError(f"{path}: a sidecar is a mapping, got {type(tree).__name__}")
    sidecar = parse_config(Sidecar, tree, source=str(path))
    for file in sidecar.files:
        if Path(file.name).name != file.name or "\\" in file.name:
            raise ValueError(f"{path}: file name {file.name!r} has a folder in it; files lie beside their sidecar")
        inside(path.parent, file.name)
        if bad := [number for number in file.textures if not 0 <= number < len(sidecar.textures)]:
            raise ValueError(f"{path}: {file.name} names textures {bad}, there are {len(sidecar.textures)}")
    for texture in sidecar.textures:
        if len(texture.transfer) != len(texture.channels):
            raise ValueError(f"{path}: texture {texture.suffix} must name one curve for each of its channels")
        if texture.transfer[3:] == ["srgb"] or len(set(texture.transfer[:3])) > 1:
            raise ValueError(f"{path}: texture {texture.suffix}: R, G, B share a curve and A is linear; correct it")
    if (sidecar.layout == "grid") != (sidecar.grid is not None):
        raise ValueError(f"{path}: a grid belongs to layout 'grid' and to no other")
    if sidecar.tile_grid and sidecar.frames > sidecar.tile_grid.tiles:
        raise ValueError(f"{path}: {sidecar.frames} frames do not fit the grid of {sidecar.tile_grid.tiles} tiles")
    held = {name for texture in sidecar.textures for name in texture.channels}
    if sidecar.motion and not set(MOTION_CHANNELS) <= held:
        raise ValueError(f"{path}: tells of motion, but no texture holds {' and '.join(MOTION_CHANNELS)}; remove it")
    if min(sidecar.tile_px) < 1:
        raise ValueError(f"{path}: tile_px {sidecar.tile_px} must be positive")
    return sidecar
