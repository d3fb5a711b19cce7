"""Bounds that a volume file must respect before any memory is given to it: files are hostile."""

LARGEST_VOXELS = 1 << 30
LARGEST_FILE_BYTES = 8 << 30


class VolumeError(ValueError):
    """A volume that cannot be read as smoke; the message names the file, the rule and the remedy."""


def check_size(source: str, shape_zyx: tuple[int, int, int]) -> None:
    """Raise VolumeError unless the shape is positive and at most `LARGEST_VOXELS` voxels."""
    z, y, x = shape_zyx
    if min(shape_zyx) < 1 or z * y * x > LARGEST_VOXELS:
        raise VolumeError(
            f"{source}: a grid of {x} x {y} x {z} voxels is refused; sizes run from 1 to {LARGEST_VOXELS} voxels "
            "in all: resample it, or check that the file is not damaged"
        )


def cubic_voxel(source: str, voxel_size: tuple[float, float, float]) -> float:
    """The one edge of a voxel; raises VolumeError if the three differ by more than 2 %."""
    smallest, largest = min(voxel_size), max(voxel_size)
    if not (smallest > 0.0 and largest / smallest <= 1.02):
        raise VolumeError(f"{source}: voxels of {voxel_size} are not cubes; resample the grid to equal edges")
    return float(voxel_size[0] * voxel_size[1] * voxel_size[2]) ** (1.0 / 3.0)
