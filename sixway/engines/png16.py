"""PNG files of 16 bits a channel, which Pillow cannot write and reads as 8 bits without a word."""

import struct
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import UInt16

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES = {0: 1, 2: 3, 6: 4}


def write_png16(path: Path, pixels: UInt16[np.ndarray, "h w c"]) -> None:
    """Write grey (c = 1), RGB (3) or RGBA (4); the caller gives a temporary path."""
    height, width, count = pixels.shape
    kind = {planes: kind for kind, planes in _COLOUR_TYPES.items()}[count]
    rows = np.ascontiguousarray(pixels.astype(">u2")).view(np.uint8).reshape(height, -1)
    above = np.vstack([np.zeros_like(rows[:1]), rows[:-1]])
    filtered = np.hstack([np.full((height, 1), 2, np.uint8), rows - above])  # filter 2: difference to the row above
    header = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 6)), (b"IEND", b"")
    path.write_bytes(_SIGNATURE + b"".join(_chunk(name, data) for name, data in chunks))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def bit_depth(path: Path) -> int:
    """Bits a channel that the header of a PNG names; 0 if the file is no PNG."""
    with path.open("rb") as file:
        head = file.read(26)
    return head[24] if len(head) == 26 and head.startswith(_SIGNATURE) else 0


def read_png16(path: Path, *, largest_pixels: int) -> UInt16[np.ndarray, "h w c"]:
    """Read a 16-bit PNG, grey, RGB or RGBA. Raises ValueError for interlaced, damaged or too large files."""
    data = path.read_bytes()
    header, packed, at = b"", [], len(_SIGNATURE)
    while at + 8 <= len(data):
        length, name = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if name == b"IHDR":
            header = body
        elif name == b"IDAT":
            packed.append(body)
        at += length + 12
    if len(header) != 13:
        raise ValueError(f"{path}: a PNG without a header; export it again")
    width, height, depth, kind, _, _, interlace = struct.unpack(">IIBBBBB", header)
    if depth != 16 or kind not in _COLOUR_TYPES or interlace:
        raise ValueError(f"{path}: only plain grey, RGB and RGBA PNGs are read; save it as such, not interlaced")
    if width * height > largest_pixels:
        raise ValueError(f"{path}: {width} x {height} px, the limit is {largest_pixels} pixels; split the file")
    step = 2 * _COLOUR_TYPES[kind]
    wanted = height * (width * step + 1)
    try:
        raw = zlib.decompressobj().decompress(b"".join(packed), wanted)
    except zlib.error as error:
        raise ValueError(f"{path}: damaged PNG data ({error}); export it again") from error
    if len(raw) != wanted:
        raise ValueError(f"{path}: the PNG ends early; export it again")
    lines = np.frombuffer(raw, np.uint8).reshape(height, -1)
    rows = np.zeros((height, width * step), np.uint8)
    above = np.zeros(width * step, np.uint8)
    for y in range(height):
        rows[y] = above = _unfilter(int(lines[y, 0]), lines[y, 1:], above, step, path)
    return rows.view(">u2").reshape(height, width, -1).astype(np.uint16)


def _unfilter(kind: int, line: np.ndarray, above: np.ndarray, step: int, path: Path) -> np.ndarray:
    """One row back from its filter (PNG specification, section 9)."""
    match kind:
        case 0:
            return line
        case 1:
            return np.cumsum(line.reshape(-1, step), axis=0, dtype=np.uint8).reshape(-1)
        case 2:
            return line + above
        case 3 | 4:
            row = [0] * step
            up = [0] * step + above.tolist()
            for i, value in enumerate(line.tolist(), start=step):
                left, top, corner = row[i - step], up[i], up[i - step]
                row.append((value + ((left + top) // 2 if kind == 3 else _paeth(left, top, corner))) & 255)
            return np.array(row[step:], np.uint8)
    raise ValueError(f"{path}: unknown PNG filter {kind}; the file is damaged, export it again")


def _paeth(left: int, top: int, corner: int) -> int:
    guess = left + top - corner
    near = (abs(guess - left), abs(guess - top), abs(guess - corner))
    return left if near[0] <= near[1] and near[0] <= near[2] else top if near[1] <= near[2] else corner
