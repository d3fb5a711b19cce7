"""Carrying scalars: what is known exactly, the float64 oracle, bounds, walls, and that skipping changes nothing."""

import numpy as np
import pytest
import warp as wp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sixway.sim.carried import oracle, survey_kernels
from sixway.sim.carried.scalars import SIDES, FaceKind, Scalars, Scheme

SCHEMES: tuple[Scheme, ...] = ("cubic", "linear")


def carried(
    device: str,
    velocity: np.ndarray,
    fields: np.ndarray,
    *,
    refinement: int = 2,
    steps: float = 4.0,
    scheme: Scheme = "cubic",
    faces: dict | None = None,
    solid: np.ndarray | None = None,
    solid_before: np.ndarray | None = None,
    floor: float = 0.0,
    threads: int = 1,
    times: int = 1,
) -> np.ndarray:
    """`fields` [f, z, y, x] after some steps of the wind [z, y, x, 3], which has its shell."""
    names = tuple("abcdefgh"[: len(fields)])
    shape = tuple(n - 2 for n in velocity.shape[:3])
    scalars = Scalars(
        names,
        shape_zyx=shape,
        refinement=refinement,
        scheme=scheme,
        faces=faces,
        floor=floor,
        device=device,
        threads=threads,
    )
    state = {f"scalar.{name}": field.astype(np.float32) for name, field in zip(names, fields, strict=True)}
    before = np.zeros(fields.shape[1:]) if solid_before is None else solid_before
    scalars.restore({**state, "scalar_solid": before.astype(np.uint8)})
    wind = wp.array(velocity, dtype=wp.vec3, device=device)
    fraction = None if solid is None else wp.array(solid, dtype=wp.float32, device=device)
    for _ in range(times):
        scalars.advect(wind, steps=steps, solid_fraction=fraction)
    return scalars.stacked.numpy().copy()


def even_wind(shape_zyx: tuple[int, int, int], u: tuple[float, float, float]) -> np.ndarray:
    return np.broadcast_to(np.array(u), (*(n + 2 for n in shape_zyx), 3)).copy()


@pytest.mark.parametrize("refinement", [1, 2, 4])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_whole_voxels_are_exact(device: str, rng: np.random.Generator, scheme: Scheme, refinement: int) -> None:
    fields = rng.random((2, 16, 16, 16)).astype(np.float32)
    cells = (16 // refinement,) * 3
    wind = even_wind(cells, (0.5 / refinement, -0.25 / refinement, 0.75 / refinement))  # 2, -1, 3 voxels
    everywhere: FaceKind = "periodic"
    after = carried(device, wind, fields, refinement=refinement, scheme=scheme, faces=dict.fromkeys(SIDES, everywhere))
    np.testing.assert_array_equal(after, np.roll(fields, (3, -1, 2), axis=(1, 2, 3)))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_constant_stays_constant(device: str, rng: np.random.Generator, scheme: Scheme) -> None:
    velocity = rng.uniform(-0.5, 0.5, (9, 10, 11, 3))
    fraction = rng.random((14, 16, 18))
    fraction[:2] = 0.0
    solid = fraction >= 0.7
    fields = np.where(solid, 0.0, 0.7)[None]
    after = carried(device, velocity, fields, scheme=scheme, solid=fraction >= 0.7, solid_before=solid)
    np.testing.assert_array_equal(after[0], np.where(solid, 0.0, np.float32(0.7)))


@pytest.mark.parametrize("refinement", [1, 2, 4])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_kernels_equal_the_oracle(device: str, rng: np.random.Generator, scheme: Scheme, refinement: int) -> None:
    cells = (5, 6, 4) if refinement == 4 else (7, 9, 8)
    shape = tuple(refinement * n for n in cells)
    velocity = rng.uniform(-0.4, 0.4, (*(n + 2 for n in cells), 3))
    fields = rng.random((2, *shape)) * (rng.random((2, *shape)) > 0.3)
    solid_before, solid = rng.random((2, *shape)) > 0.97
    for kinds in (("closed",) * 6, ("open", "closed", "closed", "open", "periodic", "periodic")):
        options = {"refinement": refinement, "steps": 3.0, "scheme": scheme, "floor": 1e-6}
        walls = {"solid": solid, "solid_before": solid_before}
        after = carried(device, velocity, fields, **options, **walls, faces=dict(zip(SIDES, kinds, strict=True)))
        codes = tuple({"closed": 0, "open": 1, "periodic": 2}[kind] for kind in kinds)
        expected = oracle.advect(velocity, fields, **options, **walls, faces=codes)
        np.testing.assert_allclose(after, expected, atol=1e-5)


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0.0, 2.0), scheme=st.sampled_from(SCHEMES))
def test_bounds_are_kept(device: str, seed: int, speed: float, scheme: Scheme) -> None:
    rng = np.random.default_rng(seed)
    fields = rng.uniform(-1.0, 2.0, (1, 12, 12, 12)).astype(np.float32)
    fields[0, rng.random((12, 12, 12)) > 0.5] = 0.0
    solid = rng.random((12, 12, 12)) > 0.95
    after = carried(device, rng.uniform(-speed, speed, (8, 8, 8, 3)), fields, scheme=scheme, solid=solid)
    assert after.min() >= min(fields.min(), 0.0)
    assert after.max() <= fields.max()


def puff(shape: tuple[int, int, int], centre: tuple[float, float, float], radius: float) -> np.ndarray:
    z, y, x = np.indices(shape)
    r2 = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2
    return np.where(r2 < radius**2, 1.0 + 0.3 * np.sin(x) * np.cos(y + z), 0.0)


class Unskipped(Scalars):
    """Looks into every block as if smoke and walls were everywhere."""

    def _survey(self, velocity: wp.array, steps: float, fraction: wp.array) -> None:
        super()._survey(velocity, steps, fraction)
        self._flags.fill_(survey_kernels.SOLID_BIT | (1 << len(self.names)) - 1)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("speed", [0.05, 0.6])
def test_skipping_and_threads_change_no_byte(
    device: str, rng: np.random.Generator, scheme: Scheme, speed: float
) -> None:
    shape = (30, 34, 38)
    fields = np.stack([puff(shape, (14, 18, 12), 5.0), puff(shape, (33, 6, 20), 3.0)])
    velocity = wp.array(rng.uniform(-speed, speed, (17, 19, 21, 3)), dtype=wp.vec3, device=device)
    solid = wp.array(puff(shape, (20, 18, 14), 4.0) > 0, dtype=wp.float32, device=device)
    after = []
    for kind, threads in ((Scalars, 1), (Scalars, 2), (Unskipped, 1)):
        scalars = kind(
            ("a", "b"),
            shape_zyx=(15, 17, 19),
            refinement=2,
            scheme=scheme,
            faces={"x_low": "periodic", "x_high": "periodic", "y_high": "open"},
            device=device,
            threads=threads,
        )
        for name, field in zip("ab", fields, strict=True):
            scalars.fields[name].assign(field.astype(np.float32))
        for _ in range(3):
            scalars.advect(velocity, steps=4.0, solid_fraction=solid)
        after.append(scalars.stacked.numpy().tobytes())
    assert after[0] == after[1]
    assert after[0] == after[2]
    assert any(after[0])


@pytest.mark.parametrize("refinement", [1, 2, 4])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_thin_plate_is_tight(device: str, scheme: Scheme, refinement: int) -> None:
    """A wind that blows straight through a plate of two cells, tilted or not, up to four cells a step."""
    n = 10 * refinement
    _, y, x = np.indices((n, n, n))
    for tilt in (0.0, 0.5):
        across = (x - n / 2 + tilt * (y - n / 2)) / np.hypot(1.0, tilt)
        plate = np.abs(across + 0.01) <= refinement
        smoke = np.where((across < 0) & ~plate, 1.0, 0.0)[None]
        for speed in (0.02, 0.13, 1.0):
            wind = even_wind((10, 10, 10), (speed, -tilt * speed, 0.3 * speed))
            after = carried(
                device,
                wind,
                smoke,
                refinement=refinement,
                scheme=scheme,
                solid=plate,
                solid_before=plate,
                times=6,
            )
            assert after[0][(across > 0) & ~plate].max() == 0.0
            assert after[0][plate].max() == 0.0
            assert after[0].max() == pytest.approx(1.0)


def test_smoke_beside_a_wall_is_not_eaten(device: str, rng: np.random.Generator) -> None:
    """Air that comes along and from a wall keeps its smoke: solid voxels take no part in interpolation."""
    wind = even_wind((8, 8, 8), (0.0, 0.013, 0.037))
    wall = np.zeros((16, 16, 16))
    wall[:, :4] = 1.0
    smoke = np.where(wall > 0, 0.0, 1.0)[None]
    after = carried(device, wind, smoke, solid=wall, solid_before=wall > 0, times=20)
    np.testing.assert_array_equal(after, smoke)


def test_a_moving_wall_pushes_smoke_ahead(device: str) -> None:
    """A piston takes the smoke along, lets none through, and leaves clear air behind."""
    n, speed = 32, 0.5 / 4 / 2  # half a voxel each advection of four steps
    scalars = Scalars(("smoke",), shape_zyx=(4, 4, n // 2), refinement=2, device=device)
    smoke = np.zeros((8, 8, n), np.float32)
    smoke[:, :, 7:11] = 1.0  # touches the piston, which fills 2 to 6 at first
    scalars.fields["smoke"].assign(smoke)
    wind = wp.array(even_wind((4, 4, n // 2), (speed, 0.0, 0.0)), dtype=wp.vec3, device=device)
    x = np.broadcast_to(np.arange(n), smoke.shape)
    mass = []
    for step in range(16):
        front = 6.0 + 0.5 * step
        fraction = np.clip(0.5 - np.abs(x - front + 2.0) + 2.0, 0.0, 1.0).astype(np.float32)
        steps = 4.0 if step else 0.0  # the first call only tells where the piston stands
        scalars.advect(wind, steps=steps, solid_fraction=wp.array(fraction, dtype=wp.float32, device=device))
        now = scalars.fields["smoke"].numpy()
        assert now[fraction >= 0.5].max() == 0.0
        assert now[x < front - 4.5].max() == 0.0
        mass.append(scalars.mass()["smoke"])
    np.testing.assert_allclose(mass[::2], 8 * 8 * 4, rtol=0.01)
    np.testing.assert_allclose(mass, 8 * 8 * 4, atol=8 * 8 * 0.501)  # the piston's face is rounded to voxels


@pytest.mark.parametrize("scheme", SCHEMES)
def test_open_faces_let_clear_air_in_and_closed_ones_none(device: str, scheme: Scheme) -> None:
    smoke = np.ones((1, 8, 8, 8))
    wind = even_wind((4, 4, 4), (0.0, -0.25, 0.0))  # down by two voxels
    after = carried(device, wind, smoke, scheme=scheme, faces={"y_high": "open"})
    np.testing.assert_array_equal(after[0][:, -2:], 0.0)
    np.testing.assert_array_equal(after[0][:, :-2], 1.0)
    np.testing.assert_array_equal(carried(device, wind, smoke, scheme=scheme), smoke)


def test_a_wind_that_blew_up_stays_in_the_arrays(device: str) -> None:
    wind = np.full((6, 6, 6, 3), np.nan)
    wind[3] = np.inf
    solid = np.zeros((8, 8, 8))
    solid[2, 2, 2] = 1.0
    for scheme in SCHEMES:
        carried(device, wind, np.ones((1, 8, 8, 8)), scheme=scheme, solid=solid)


def test_nan_in_a_field_stays_in_sight(device: str) -> None:
    field = np.ones((1, 8, 8, 8))
    field[0, 4, 4, 4] = np.nan
    after = carried(device, even_wind((4, 4, 4), (0.01, 0.0, 0.0)), field, floor=1e-6)
    assert np.isnan(after).any()
