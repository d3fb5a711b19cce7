"""Fire out of files: which grid burns, how its values glow, one strength for a sequence."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.extinction import DEFAULT_RADIANCE, thick_column
from sixway.volumes.fire import EmissionRule
from sixway.volumes.limits import VolumeError
from sixway.volumes.nanovdb_write import write_nanovdb
from sixway.volumes.npz import write_npz
from sixway.volumes.read import read_volume
from sixway.volumes.sequence import open_sequence

SHAPE = (4, 5, 6)


def saved(path: Path, **arrays: object) -> Path:
    np.savez(path, density=np.ones(SHAPE, np.float32), voxel_size_m=0.25, **arrays)
    return path


def volume(value: float) -> np.ndarray:
    return np.full(SHAPE, value, np.float32)


@pytest.mark.parametrize("name", ["flame", "Flames", "fire", "EMISSION", "burn", "emissive"])
def test_fire_is_known_by_its_name(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path / "a.npz", **{name: volume(0.5)}, temperature=volume(3.0), fuel=volume(1.0))
    np.testing.assert_array_equal(read_volume(path).emission, volume(0.5))
    assert read_volume(path, emission=None).emission is None


def test_heat_and_fuel_burn_only_when_they_are_named(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.npz", temperature=volume(3.0), heat=volume(1.0), fuel=volume(0.25))
    assert read_volume(path).emission is None
    for name, expected in (("temperature", 1.0), ("heat", 0.0), ("fuel", 0.25)):
        frame = read_volume(path, emission=EmissionRule(grid_name=name))
        np.testing.assert_allclose(frame.emission, expected)


@pytest.mark.parametrize(
    ("rule", "name", "values", "expected"),
    [
        (EmissionRule(strength_per_m=3.0), "flame", [-1.0, 0.0, 0.5, 2.0], [0.0, 0.0, 1.5, 6.0]),
        (EmissionRule(power=2.0), "flame", [-1.0, 0.5, 2.0], [0.0, 0.25, 4.0]),
        (EmissionRule(), "temperature", [0.0, 1.5, 2.25, 3.0], [0.0, 0.0, 0.5, 1.0]),
        (EmissionRule(), "Temperature", [293.0, 798.0, 1596.0], [0.0, 0.0, 1.0]),
        (EmissionRule(threshold=1000.0, power=2.0), "temperature", [300.0, 1500.0], [0.0, 0.25]),
        (EmissionRule(threshold=0.0), "temperature", [1.0], [1.0]),
        (EmissionRule(threshold=1.0), "flame", [1.5], [0.5]),
    ],
)
def test_the_rule_from_value_to_emission(rule: EmissionRule, name: str, values: list, expected: list) -> None:
    grid = np.array(values, np.float32).reshape(1, 1, -1)
    np.testing.assert_allclose(rule.emission(grid, name)[0, 0], expected, rtol=1e-6)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 3e38])
def test_fire_that_is_not_finite_is_refused_with_a_remedy(tmp_path: Path, bad: float) -> None:
    path = saved(tmp_path / "a.npz", flame=volume(bad))
    with pytest.raises(VolumeError, match="--emission none"):
        read_volume(path, emission=EmissionRule(strength_per_m=10.0))
    assert read_volume(path, emission=None).density.all()


@pytest.mark.parametrize(
    "wrong", [{"strength_per_m": 0.0}, {"strength_per_m": np.inf}, {"threshold": -1.0}, {"power": 0.0}]
)
def test_rules_that_make_no_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="emission"):
        EmissionRule(**wrong)


def test_a_grid_that_is_not_there_is_told_with_what_there_is(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.npz", flame=volume(1.0))
    with pytest.raises(VolumeError, match=r"no grid 'fyre' \(it holds: .*'flame'.*name one of these with --emission"):
        read_volume(path, emission=EmissionRule(grid_name="fyre"))
    with pytest.raises(VolumeError, match=r"not numbers \[z, y, x\]"):
        read_volume(saved(tmp_path / "b.npz", flame=np.ones(3)))


def test_our_own_frames_keep_their_emission_and_turn_with_it(tmp_path: Path) -> None:
    emission = np.arange(120, dtype=np.float32).reshape(SHAPE)
    grid = Grid(shape_zyx=SHAPE, voxel_size_m=0.25)
    write_npz(tmp_path / "a.npz", DensityFrame(density=volume(1.0), grid=grid, emission=emission, time_s=2.0))
    frame = read_volume(tmp_path / "a.npz")
    np.testing.assert_array_equal(frame.emission, emission)
    assert frame.time_s == 2.0
    turned = read_volume(tmp_path / "a.npz", up="z").emission
    np.testing.assert_array_equal(turned, np.swapaxes(emission, 0, 1)[::-1])


def test_one_strength_for_a_sequence(tmp_path: Path) -> None:
    """The brightest frame gets the default radiance through its thick columns; a frame without fire gets zeros."""
    grid = Grid(shape_zyx=SHAPE, voxel_size_m=0.25)
    smoke = DensityFrame(density=volume(1.0), grid=grid)
    paths = [tmp_path / f"{i}.npz" for i in range(3)]
    for path, fire in zip(paths, (0.2, 0.8, None), strict=True):
        write_npz(path, smoke if fire is None else replace(smoke, emission=volume(fire)))
    sequence = open_sequence(paths)
    dim, bright, cold = (sequence.read(i).emission for i in range(3))
    assert thick_column(bright, 0.25) == pytest.approx(DEFAULT_RADIANCE)
    np.testing.assert_allclose(dim, bright / 4.0, rtol=1e-6)
    assert cold is not None and not cold.any()
    told = open_sequence(paths, emission=EmissionRule(strength_per_m=2.0))
    np.testing.assert_allclose(told.read(0).emission, 0.4)
    for never in (open_sequence(paths, emission=None), open_sequence(paths[2:])):
        assert never.emission is None and never.read(0).emission is None


def test_real_fire_burns_out(real_volumes: Path) -> None:
    folder = real_volumes / "mantaflow_fire"
    frames = {n: read_volume(folder / f"fluid_data_00{n}.vdb", up="z") for n in ("08", "24", "32", "40")}
    for number in ("32", "40"):
        assert frames[number].emission is not None and not frames[number].emission.any()
    flame = read_volume(folder / "fluid_data_0024.vdb", up="z", grid="flame", emission=None)
    fire = frames["24"]
    assert fire.emission.sum() == pytest.approx(flame.density.sum())  # moved whole into the larger box of the smoke
    first = [round((a - b) / 0.0625) for a, b in zip(flame.grid.origin_m, fire.grid.origin_m, strict=True)]
    inner = tuple(slice(s, s + n) for s, n in zip(reversed(first), flame.density.shape, strict=True))
    np.testing.assert_array_equal(fire.emission[inner], flame.density)
    hot = read_volume(folder / "fluid_data_0008.vdb", up="z", emission=EmissionRule(grid_name="temperature"))
    assert 0.9 < hot.emission.max() < 1.0
    with pytest.raises(VolumeError, match="holds vec3s values"):
        read_volume(folder / "fluid_data_0008.vdb", emission=EmissionRule(grid_name="velocity"))
    sequence = open_sequence(sorted(folder.glob("*.vdb")), up="z")
    assert all(sequence.read(i).emission is not None for i in range(5))


def nvdb(folder: Path, smoke: DensityFrame, fire: DensityFrame) -> Path:
    """Two grids in one file, as converters write them: a segment each."""
    for name, frame in (("smoke", smoke), ("fire", fire)):
        write_nanovdb(folder / f"{name}.nvdb", frame)
    renamed = (folder / "fire.nvdb").read_bytes().replace(b"density\0", b"flame\0\0\0", 1)
    path = folder / "both.nvdb"
    path.write_bytes((folder / "smoke.nvdb").read_bytes() + renamed)
    return path


def at(first_x: int, value: float, *, voxel_size_m: float = 0.5) -> DensityFrame:
    grid = Grid(shape_zyx=(3, 3, 4), voxel_size_m=voxel_size_m, origin_m=(first_x * voxel_size_m, 0.0, 0.0))
    return DensityFrame(density=np.full(grid.shape_zyx, value, np.float32), grid=grid)


def test_fire_beyond_the_smoke_widens_the_box(tmp_path: Path) -> None:
    frame = read_volume(nvdb(tmp_path, at(0, 2.0), at(-2, 0.5)))
    assert frame.grid.shape_zyx == (3, 3, 6)
    assert frame.grid.origin_m == pytest.approx((-1.0, 0.0, 0.0))
    np.testing.assert_array_equal(frame.density[0, 0], [0.0, 0.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(frame.emission[0, 0], [0.5, 0.5, 0.5, 0.5, 0.0, 0.0])


def test_fire_before_there_is_smoke_has_its_own_box(tmp_path: Path) -> None:
    frame = read_volume(nvdb(tmp_path, at(0, 0.0), at(7, 0.5)))
    assert frame.grid.origin_m == pytest.approx((3.5, 0.0, 0.0))
    assert frame.emission.all() and not frame.density.any()


def test_fire_in_other_voxels_is_refused(tmp_path: Path) -> None:
    path = nvdb(tmp_path, at(0, 1.0), at(0, 1.0, voxel_size_m=1.0))
    with pytest.raises(VolumeError, match="'flame': its voxels are 1 m wide.*resample them"):
        read_volume(path)
    assert read_volume(path, emission=None).density.all()
