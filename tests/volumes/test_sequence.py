"""A sequence of sparse boxes: one common box, one density scale, nothing moved."""

from pathlib import Path

import numpy as np
import pytest

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError
from sixway.volumes.npz import write_npz
from sixway.volumes.read import find_volumes
from sixway.volumes.sequence import open_sequence, placed, slice_frames

SIZE = 0.25


def frame_at(first_xyz: tuple[int, int, int], shape_zyx: tuple[int, int, int], value: float = 1.0) -> DensityFrame:
    x, y, z = (SIZE * i for i in first_xyz)
    grid = Grid(shape_zyx=shape_zyx, voxel_size_m=SIZE, origin_m=(x, y, z))
    return DensityFrame(density=np.full(shape_zyx, value, np.float32), grid=grid)


def written(folder: Path, *frames: DensityFrame) -> list[Path]:
    for number, frame in enumerate(frames):
        write_npz(folder / f"smoke_{number}.npz", frame)
    return find_volumes(str(folder / "smoke_*.npz"))


def test_the_common_box_holds_every_frame_where_it_was(tmp_path: Path) -> None:
    small, large = frame_at((0, 0, 0), (2, 3, 4)), frame_at((-5, 2, 1), (6, 4, 3), 2.0)
    sequence = open_sequence(written(tmp_path, small, large))
    assert sequence.grid.shape_zyx == (7, 6, 9)  # z 0..6, y 0..5, x -5..3
    assert sequence.grid.origin_m == pytest.approx((-5 * SIZE, 0.0, 0.0))
    first, second = sequence.read(0), sequence.read(1)
    assert first.grid == second.grid == sequence.grid
    expected = np.zeros((7, 6, 9), np.float32)
    expected[0:2, 0:3, 5:9] = 1.0
    np.testing.assert_array_equal(first.density, expected)
    assert second.density.sum() == large.density.sum()
    assert sequence.highest_density == 2.0


def test_the_densest_frame_sets_the_scale(tmp_path: Path) -> None:
    thin, thick = frame_at((0, 0, 0), (4, 4, 4), 0.1), frame_at((0, 0, 0), (4, 4, 4), 3.0)
    sequence = open_sequence(written(tmp_path, thin, thick), optical_depth=8.0)
    assert sequence.extinction_per_m * 3.0 * 4 * SIZE == pytest.approx(8.0)


def test_frames_without_smoke_neither_widen_the_box_nor_stop_the_sequence(tmp_path: Path) -> None:
    paths = written(tmp_path, frame_at((90, 0, 0), (8, 8, 8), 0.0), frame_at((0, 0, 0), (4, 4, 4)))
    sequence = open_sequence(paths)
    assert sequence.grid.shape_zyx == (4, 4, 4)
    assert not sequence.read(0).density.any()
    assert sequence.read(1).density.all()
    with pytest.raises(VolumeError, match="holds no smoke"):
        open_sequence(paths[:1])


def test_voxels_of_two_sizes_are_refused(tmp_path: Path) -> None:
    other = DensityFrame(density=np.ones((4, 4, 4), np.float32), grid=Grid.centred((4, 4, 4)))
    odd = DensityFrame(density=other.density, grid=Grid(shape_zyx=(4, 4, 4), voxel_size_m=0.5))
    with pytest.raises(VolumeError, match="resample them to one voxel size"):
        open_sequence(written(tmp_path, other, odd))


def test_what_lies_outside_the_box_is_cut_off() -> None:
    frame = frame_at((-1, 0, 0), (2, 2, 4))
    grid = Grid(shape_zyx=(2, 2, 2), voxel_size_m=SIZE)
    assert placed(frame, grid).density.shape == (2, 2, 2)
    far = Grid(shape_zyx=(2, 2, 2), voxel_size_m=SIZE, origin_m=(9.0, 9.0, 9.0))
    assert not placed(frame, far).density.any()


@pytest.mark.parametrize("text", ["3", "2:1", "0:9", "a:b", "1:1", ":2"])
def test_frame_ranges_that_make_no_sense(text: str) -> None:
    with pytest.raises(ValueError, match="is not A:B"):
        slice_frames([Path(str(i)) for i in range(4)], text)


def test_a_frame_range_excludes_its_end() -> None:
    paths = [Path(str(i)) for i in range(4)]
    assert slice_frames(paths, "1:3") == paths[1:3]
    assert slice_frames(paths, None) == paths
