"""DDS files with the DX10 header: RGBA of bytes or half floats, BC7, single textures and arrays, no mips."""

import io
import struct
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, UnidentifiedImageError

DdsFormat = Literal["rgba8", "rgba16f", "bc7"]

# DXGI_FORMAT numbers: (linear, sRGB)
_DXGI = {"rgba8": (28, 29), "rgba16f": (10, 10), "bc7": (98, 99)}
_HEADER_BYTES = 148
LARGEST_SLICES = 4096


def _header(kind: DdsFormat, *, srgb: bool, width: int, height: int, slices: int) -> bytes:
    blocks = kind == "bc7"
    flags = 0x1007 | (0x80000 if blocks else 0x8)  # caps, height, width, format; linear size or pitch
    pitch = -(-width // 4) * -(-height // 4) * 16 if blocks else width * (4 if kind == "rgba8" else 8)
    main = struct.pack("<7I44x", 124, flags, height, width, pitch, 1, 1)
    pixel_format = struct.pack("<2I4s5I", 32, 0x4, b"DX10", 0, 0, 0, 0, 0)
    caps = struct.pack("<5I", 0x1000, 0, 0, 0, 0)
    return b"DDS " + main + pixel_format + caps + struct.pack("<5I", _DXGI[kind][srgb], 3, 0, slices, 0)


def write_dds(path: Path, slices: np.ndarray, kind: DdsFormat, *, srgb: bool) -> None:
    """Write [n, h, w, 4] as one texture (n = 1) or an array: bytes for rgba8 and bc7, floats for rgba16f.

    srgb marks RGB as sRGB-coded (A never is). Raises ValueError for BC7 without the extra ``textures`` and for
    sizes that are no multiples of 4.
    """
    count, height, width, _ = slices.shape
    payload = b"".join(_payload(one, kind) for one in slices)
    path.write_bytes(_header(kind, srgb=srgb, width=width, height=height, slices=count) + payload)


def _payload(pixels: np.ndarray, kind: DdsFormat) -> bytes:
    match kind:
        case "rgba8":
            return pixels.astype(np.uint8).tobytes()
        case "rgba16f":
            return pixels.astype("<f2").tobytes()
        case "bc7":
            return _bc7(pixels.astype(np.uint8))


def _bc7(pixels: UInt8[np.ndarray, "h w 4"]) -> bytes:
    height, width, _ = pixels.shape
    if height % 4 or width % 4:
        raise ValueError(f"BC7 stores blocks of 4 x 4 px, the texture is {width} x {height}; change the grid or tiles")
    try:
        import etcpak
    except ImportError as error:
        raise ValueError("BC7 needs etcpak: pip install 'sixway[textures]', or take --format dds_rgba16f") from error
    return bytes(etcpak.compress_bc7(np.ascontiguousarray(pixels).tobytes(), width, height))


def read_dds(path: Path, *, largest_pixels: int) -> Float[np.ndarray, "n h w 4"] | UInt8[np.ndarray, "n h w 4"]:
    """Read what :func:`write_dds` writes: bytes as stored (rgba8, bc7) or float32 (rgba16f).

    Raises ValueError for other formats and for damaged or too large files.
    """
    data = path.read_bytes()
    if len(data) < _HEADER_BYTES or data[:4] != b"DDS " or data[84:88] != b"DX10":
        raise ValueError(f"{path}: no DDS file with a DX10 header; export it as one, or as PNG")
    height, width = struct.unpack("<2I", data[12:20])
    dxgi, _, _, slices, _ = struct.unpack("<5I", data[128:148])
    kinds = [kind for kind, numbers in _DXGI.items() if dxgi in numbers]
    if not kinds:
        raise ValueError(f"{path}: DXGI format {dxgi} is not read; save it as RGBA8, RGBA16F or BC7")
    if not (1 <= slices <= LARGEST_SLICES and 0 < height * width * slices <= largest_pixels):
        raise ValueError(f"{path}: {slices} x {width} x {height} px is over the limit of {largest_pixels} pixels")
    kind = kinds[0]
    size = -(-width // 4) * -(-height // 4) * 16 if kind == "bc7" else height * width * (4 if kind == "rgba8" else 8)
    body = data[_HEADER_BYTES:]
    if len(body) < slices * size:
        raise ValueError(f"{path}: the file ends early; export it again")
    parts = [body[i * size : (i + 1) * size] for i in range(slices)]
    match kind:
        case "rgba16f":
            return np.stack([np.frombuffer(p, "<f2").reshape(height, width, 4) for p in parts]).astype(np.float32)
        case "rgba8":
            return np.stack([np.frombuffer(p, np.uint8).reshape(height, width, 4) for p in parts])
    head = _header("bc7", srgb=False, width=width, height=height, slices=1)
    try:
        return np.stack([np.array(Image.open(io.BytesIO(head + p)).convert("RGBA")) for p in parts])
    except (UnidentifiedImageError, OSError, ValueError) as error:
        raise ValueError(f"{path}: damaged BC7 data ({error}); export it again") from error
