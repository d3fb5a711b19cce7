"""One door for volumes: any file that we know -> DensityFrame, y up."""

import glob
from pathlib import Path
from typing import Literal

import numpy as np

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.fire import EmissionRule, with_fire
from sixway.volumes.limits import VolumeError
from sixway.volumes.listing import GridInfo
from sixway.volumes.nanovdb import list_nanovdb, read_nanovdb
from sixway.volumes.npz import read_npy, read_npz
from sixway.volumes.pbrt import read_pbrt
from sixway.volumes.vdb import list_vdb, read_vdb
from sixway.volumes.vol import read_vol

Up = Literal["y", "z"]
_FIRE_BY_NAME = EmissionRule()
READABLE = (".vdb", ".nvdb", ".vol", ".npz", ".npy", ".pbrt")
CHECKPOINT = "checkpoint.npz"
"""What a simulation leaves among its frames to go on from: no volume."""


def read_volume(
    path: Path, *, grid: str | None = None, up: Up = "y", emission: EmissionRule | None = _FIRE_BY_NAME
) -> DensityFrame:
    """Read a volume of any format in `READABLE`.

    grid: name of the smoke's grid in a .vdb or .nvdb; None or "density" also take the only scalar fog grid,
    whatever its name. A grid without smoke is zeros. up: which axis of the file points up; z-up is turned to our
    y-up. emission: which grid of a .vdb, .nvdb or .npz burns, and how brightly (`EmissionRule`); None reads none.
    Raises FileNotFoundError, or VolumeError with the reason and the remedy.
    """
    _check_exists(path)
    try:
        match path.suffix.lower():
            case ".vdb":
                frame = read_vdb(path, grid_name=grid)
            case ".nvdb":
                frame = read_nanovdb(path, grid_name=grid)
            case ".vol":
                frame = read_vol(path)
            case ".npz":
                frame = read_npz(path)
            case ".npy":
                frame = read_npy(path)
            case ".pbrt":
                frame = read_pbrt(path)
            case suffix:
                known = " ".join(READABLE)
                raise VolumeError(f"{path}: cannot read {suffix or 'files without a suffix'!r}; known: {known}")
        frame = with_fire(path, frame, emission)
        return frame if up == "y" else z_up_to_y_up(frame)
    except VolumeError:
        raise
    except (ValueError, OverflowError) as error:  # a record or grid that refuses what a damaged file says
        raise VolumeError(f"{path}: {error}; export the file again") from error
    except MemoryError as error:
        raise VolumeError(f"{path}: needs more memory than there is; crop or resample the grid") from error


def list_grids(path: Path) -> list[GridInfo]:
    """What a file holds: names, kinds, classes and index boxes. A format without names holds "density" alone.

    Raises FileNotFoundError, or VolumeError for damaged and unknown files.
    """
    _check_exists(path)
    match path.suffix.lower():
        case ".vdb":
            return list_vdb(path)
        case ".nvdb":
            return list_nanovdb(path)
    z, y, x = read_volume(path, emission=None).density.shape
    box = ((0, 0, 0), (x - 1, y - 1, z - 1))
    return [GridInfo(name="density", kind="float", grid_class="fog volume", box=box)]


def _check_exists(path: Path) -> None:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such volume")


def find_volumes(pattern: str) -> list[Path]:
    """The files that a path, a folder or a glob pattern names, in order of name.

    The state of a simulation is passed over, and of frames that a folder holds in several formats one is taken.
    Raises FileNotFoundError if there are none.
    """
    path = Path(pattern)
    if path.is_dir():
        readable = (p for p in path.iterdir() if p.suffix.lower() in READABLE and p.is_file())
        # .npz last: it alone holds wind and solids
        by_format = sorted(readable, key=lambda p: (p.suffix.lower() == ".npz", p.name))
        found = list({p.stem: p for p in by_format}.values())
    else:
        found = [Path(name) for name in glob.glob(pattern)] or [path]
    found = sorted(p for p in found if p.is_file() and (p == path or p.name != CHECKPOINT))
    if not found:
        known = " ".join(READABLE)
        raise FileNotFoundError(f"{pattern}: no volume matches; give a file ({known}), a folder or a pattern")
    return found


def z_up_to_y_up(frame: DensityFrame) -> DensityFrame:
    """Turn a z-up frame: its (x, y, z) becomes our (x, z, -y), a rotation, so nothing is mirrored."""

    def turned(volume: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(np.swapaxes(volume, 0, 1)[::-1])

    grid = frame.grid
    z, y, x = grid.shape_zyx
    origin_x, origin_y, origin_z = grid.origin_m
    velocity = None
    if frame.velocity_m_s is not None:
        wind = turned(frame.velocity_m_s)
        velocity = np.stack([wind[..., 0], wind[..., 2], -wind[..., 1]], axis=-1)
    return DensityFrame(
        density=turned(frame.density),
        grid=Grid(
            shape_zyx=(y, z, x),
            voxel_size_m=grid.voxel_size_m,
            origin_m=(origin_x, origin_z, -(origin_y + grid.extent_m[1])),
        ),
        time_s=frame.time_s,
        velocity_m_s=velocity,
        obstacle=None if frame.obstacle is None else turned(frame.obstacle),
        emission=None if frame.emission is None else turned(frame.emission),
    )
