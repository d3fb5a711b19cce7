"""Mitsuba's grid volumes (.vol): version 3, float32, one channel, z-y-x with x fastest."""

import struct
from pathlib import Path

import numpy as np

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.core.store import atomic_path
from sixway.volumes.limits import VolumeError, check_size, checked_density, cubic_voxel

_HEADER = struct.Struct("<3sB5i6f")  # magic, version, data type, x, y, z, channels, bounding box
_FLOAT32 = 1


def read_vol(path: Path) -> DensityFrame:
    """Read a density volume; raises VolumeError if it is no such file, truncated, or holds NaN."""
    with path.open("rb") as file:
        head = file.read(_HEADER.size)
        if len(head) < _HEADER.size or head[:3] != b"VOL":
            raise VolumeError(f"{path}: not a Mitsuba volume (it starts with {head[:4]!r})")
        _, version, kind, x, y, z, channels, *box = _HEADER.unpack(head)
        if version != 3 or kind != _FLOAT32 or channels != 1:
            raise VolumeError(
                f"{path}: version {version}, data type {kind}, {channels} channels; "
                "only version 3 with one float32 channel (type 1) is density"
            )
        check_size(str(path), (z, y, x))
        raw = file.read(4 * x * y * z)
    if len(raw) != 4 * x * y * z:
        raise VolumeError(f"{path}: truncated after {len(raw)} of {4 * x * y * z} bytes; copy it again")
    density = checked_density(str(path), np.frombuffer(raw, dtype="<f4").reshape(z, y, x).astype(np.float32))
    if not np.isfinite(box).all():
        raise VolumeError(f"{path}: its bounding box {tuple(box)} is damaged; export it again")
    first, last = box[:3], box[3:]
    sizes = ((last[0] - first[0]) / x, (last[1] - first[1]) / y, (last[2] - first[2]) / z)
    return DensityFrame(
        density=density,
        grid=Grid(
            shape_zyx=(z, y, x),
            voxel_size_m=cubic_voxel(str(path), sizes),
            origin_m=(first[0], first[1], first[2]),
        ),
    )


def write_vol(path: Path, frame: DensityFrame) -> None:
    """Write the density of a frame atomically; the box is stored as float32, the rest of the frame is left out."""
    z, y, x = frame.density.shape
    last = [o + length for o, length in zip(frame.grid.origin_m, frame.grid.extent_m, strict=True)]
    head = _HEADER.pack(b"VOL", 3, _FLOAT32, x, y, z, 1, *frame.grid.origin_m, *last)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(head)
        file.write(np.ascontiguousarray(frame.density, dtype="<f4").data)
