"""NumPy files: our own density frames as .npz, which the simulator writes, and a plain array as .npy."""

import math
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.core.store import atomic_path
from sixway.volumes.limits import LARGEST_FILE_BYTES, VolumeError, check_size, checked_density
from sixway.volumes.listing import GridInfo

# What zipfile and NumPy raise on damaged archives: bad bytes, bad lengths, flags of encryption or unknown methods
_DAMAGE = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    SyntaxError,
    tokenize.TokenError,
    TypeError,
    RuntimeError,
    struct.error,
    zlib.error,
    zipfile.BadZipFile,
)


def write_npz(path: Path, frame: DensityFrame, *, half: bool = False) -> None:
    """Write a frame atomically and compressed; float32, or half floats (0.05 % off) in less than half the space.

    Raises ValueError if a value is beyond the range of half floats.
    """
    arrays: dict[str, np.ndarray] = {
        "density": frame.density,
        "voxel_size_m": np.float64(frame.grid.voxel_size_m),  # type: ignore[dict-item]
        "origin_m": np.array(frame.grid.origin_m),
        "time_s": np.float64(frame.time_s),  # type: ignore[dict-item]
    }
    if frame.velocity_m_s is not None:
        arrays["velocity_m_s"] = frame.velocity_m_s
    if frame.obstacle is not None:
        arrays["obstacle"] = frame.obstacle
    if frame.emission is not None:
        arrays["emission"] = frame.emission
    if half:
        arrays = {name: values if values.ndim < 3 else _halved(name, values) for name, values in arrays.items()}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def _halved(name: str, values: np.ndarray) -> np.ndarray:
    largest = float(np.finfo(np.float16).max)
    if values.size and float(np.abs(values).max()) > largest:
        raise ValueError(f"{name} reaches {np.abs(values).max():.3g}, beyond {largest:.0f}; write it as float32")
    return values.astype(np.float16)


def read_npz(path: Path) -> DensityFrame:
    """Read a frame, or any .npz with a 3D array ``density`` [z, y, x] (then 1 m along its longest edge).

    Raises VolumeError if the file is truncated, too large, holds pickled objects, lacks ``density``, or
    holds NaN or negative values.
    """
    held = _arrays(path)
    density = held.get("density")
    if density is None or density.ndim != 3:
        raise VolumeError(f"{path}: needs a 3D array 'density' [z, y, x]; it holds {sorted(held)}")
    try:
        smoke = _density(path, density)
        return DensityFrame(
            density=smoke,
            grid=_grid(held, smoke),
            time_s=float(held.get("time_s", 0.0)),
            velocity_m_s=_optional(held.get("velocity_m_s")),
            obstacle=_optional(held.get("obstacle")),
            emission=_optional(held.get("emission")),
        )
    except VolumeError:
        raise
    except (ValueError, TypeError) as error:
        raise VolumeError(f"{path}: {error}") from error


def list_npz(path: Path) -> list[GridInfo]:
    """The arrays of a file, by name; what they hold is looked at when they are read. Raises VolumeError for damage."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist()]
    except _DAMAGE as error:
        raise VolumeError(f"{path}: not a readable .npz of plain arrays ({error}); write it again") from error
    return [GridInfo(name=name, kind="float", grid_class="unknown") for name in names]


def read_npz_values(path: Path, name: str) -> tuple[Float[np.ndarray, "z y x"], Grid]:
    """An array of a file and where it lies, its values as they stand there. Raises VolumeError."""
    held = _arrays(path)
    values = held[name]
    if values.ndim != 3 or values.dtype.kind not in "fiub":
        raise VolumeError(f"{path}: {name!r} is {values.dtype} {values.shape}, not numbers [z, y, x]; rename it")
    check_size(f"{path} ({name!r})", (values.shape[0], values.shape[1], values.shape[2]))
    with np.errstate(over="ignore", invalid="ignore"):
        values = np.ascontiguousarray(values, dtype=np.float32)
    return values, _grid(held, values)


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with zipfile.ZipFile(path) as archive:
            total = sum(entry.file_size for entry in archive.infolist())
        if total > LARGEST_FILE_BYTES:
            raise VolumeError(f"{path}: unpacks to {total} bytes, over {LARGEST_FILE_BYTES}; resample it")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (VolumeError, FileNotFoundError):
        raise
    except _DAMAGE as error:
        raise VolumeError(f"{path}: not a readable .npz of plain arrays ({error}); write it again") from error


def _grid(held: dict[str, np.ndarray], values: Float[np.ndarray, "z y x"]) -> Grid:
    z, y, x = values.shape
    if "voxel_size_m" not in held:
        return Grid.centred((z, y, x))
    return Grid(
        shape_zyx=(z, y, x),
        voxel_size_m=float(held["voxel_size_m"]),
        origin_m=tuple(float(v) for v in held.get("origin_m", (0.0, 0.0, 0.0))),  # type: ignore[arg-type]
    )


def read_npy(path: Path) -> DensityFrame:
    """Read one 3D array [z, y, x] of numbers, 1 m along its longest edge. Raises VolumeError."""
    try:
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            read_header = (
                np.lib.format.read_array_header_1_0 if version[0] == 1 else np.lib.format.read_array_header_2_0
            )
            shape, _, kind = read_header(file)
            due = math.prod(shape) * kind.itemsize  # judged before NumPy gives memory for what the header promises
            if due > path.stat().st_size - file.tell():
                raise VolumeError(f"{path}: truncated (its header tells of {due} bytes); write it again")
        density = np.load(path, allow_pickle=False)
    except VolumeError:
        raise
    except _DAMAGE as error:
        raise VolumeError(f"{path}: not a readable .npy of a plain array ({error}); write it again") from error
    if density.ndim != 3:
        raise VolumeError(f"{path}: needs a 3D array [z, y, x]; its shape is {density.shape}")
    smoke = _density(path, density)
    z, y, x = smoke.shape
    return DensityFrame(density=smoke, grid=Grid.centred((z, y, x)))


def _density(path: Path, density: np.ndarray) -> np.ndarray:
    z, y, x = density.shape
    check_size(str(path), (z, y, x))
    if density.dtype.kind not in "fiub":
        raise VolumeError(f"{path}: density holds {density.dtype}, not real numbers; convert it to float32")
    with np.errstate(over="ignore", invalid="ignore"):
        return checked_density(str(path), np.ascontiguousarray(density, dtype=np.float32))


def _optional(array: np.ndarray | None) -> np.ndarray | None:
    return None if array is None else array.astype(np.float32)
