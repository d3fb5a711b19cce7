"""One door out: a DensityFrame -> a file, its format by its suffix."""

from pathlib import Path

from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError
from sixway.volumes.nanovdb_write import write_nanovdb
from sixway.volumes.npz import write_npz
from sixway.volumes.vdb_write import write_vdb
from sixway.volumes.vol import write_vol

WRITABLE = (".vdb", ".nvdb", ".vol", ".npz")


def write_volume(path: Path, frame: DensityFrame) -> None:
    """Write a frame atomically: .npz keeps all of it, .vdb, .nvdb and .vol its density and its place.

    Files are y up, as the frame is. Raises VolumeError for another suffix, OSError when the disk is full.
    """
    match path.suffix.lower():
        case ".vdb":
            write_vdb(path, frame)
        case ".nvdb":
            write_nanovdb(path, frame)
        case ".vol":
            write_vol(path, frame)
        case ".npz":
            write_npz(path, frame)
        case suffix:
            known = " ".join(WRITABLE)
            raise VolumeError(f"{path}: cannot write {suffix or 'files without a suffix'!r}; known: {known}")
