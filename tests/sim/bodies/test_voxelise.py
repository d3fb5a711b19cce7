"""Bodies drawn into grids on the device, against their NumPy distances."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sixway.core.frames import Grid
from sixway.sim.bodies.distance_field import distance_field
from sixway.sim.bodies.motion import Keyframes, RigidMotion
from sixway.sim.bodies.shapes import Body, BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody
from sixway.sim.bodies.voxelise import ObstacleField
from sixway.sim.units import LatticeUnits

BUNNY = str(Path(__file__).parents[3] / "configs" / "sim" / "meshes" / "bunny.ply")
VELOCITY = Grid.centred((16, 20, 24))
DENSITY = Grid.centred((32, 40, 48))
UNITS = LatticeUnits(dx_m=VELOCITY.voxel_size_m, dt_s=0.004)
INSIDE = (slice(1, -1),) * 3


def draw(*bodies: Body, device: str, threads: int = 1) -> ObstacleField:
    grids = {"velocity_grid": VELOCITY, "density_grid": DENSITY}
    return ObstacleField(bodies, **grids, units=UNITS, device=device, threads=threads)


def centres(grid: Grid, *, shell: int = 0) -> np.ndarray:
    """World positions [z, y, x, 3] of the centres of an array's voxels."""
    z, y, x = (np.arange(n + 2 * shell) + 0.5 - shell for n in grid.shape_zyx)
    ijk = np.stack(np.broadcast_arrays(x, y[:, None], z[:, None, None]), axis=-1)
    return np.array(grid.origin_m) + ijk * grid.voxel_size_m


def oracle_distance(body: Body, points_m: np.ndarray, time_s: float) -> np.ndarray:
    """The NumPy distance; of meshes that of their field, as reading it is what the kernel does."""
    if not isinstance(body, MeshBody):
        return body.signed_distance(points_m, time_s)
    centre, rotation = body.placement(time_s)
    flat = ((points_m - centre) @ rotation).reshape(-1, 3) / body.size_m
    field = distance_field(body.surface, body.resolution)
    return body.size_m * field.sample(flat).reshape(points_m.shape[:-1])


def assert_drawn(field: ObstacleField, body: Body, time_s: float) -> None:
    """`field` holds `body` alone, as NumPy sees it."""
    points = centres(VELOCITY, shell=1)
    distance = oracle_distance(body, points, time_s) / VELOCITY.voxel_size_m
    solid = field.solid.numpy()
    clear = np.abs(distance) > 1e-4  # float32 may see a cell on the very surface on its other side
    assert np.array_equal(solid[clear], (distance < 0.0)[clear])
    fraction = np.clip(0.5 - oracle_distance(body, centres(DENSITY), time_s) / DENSITY.voxel_size_m, 0.0, 1.0)
    assert np.allclose(field.fraction.numpy(), fraction, atol=1e-4)
    pose = body.pose(time_s)
    speed = pose.velocity_m_s + np.cross(pose.spin_rad_s, points - body.placement(time_s)[0])
    expected = np.where(solid[..., None] == 1, UNITS.velocity_to_lattice(1.0) * speed, 0.0)
    assert np.allclose(field.wall_velocity.numpy(), expected, atol=1e-6)


turns = st.tuples(*[st.floats(-180.0, 180.0)] * 3)
places = st.tuples(*[st.floats(-0.6, 0.6)] * 3)  # some stand half or wholly outside
KINDS = ["sphere", "endless", "cylinder", "capsule", "box", "mesh"]


def body_of(kind: str, centre: tuple, turn: tuple, motion: RigidMotion | None) -> Body:
    axis = tuple(Rotation.from_rotvec(turn, degrees=True).apply([0.0, 0.0, 1.0]).clip(-1.0, 1.0).tolist())
    common = {"centre_m": centre, "motion": motion}
    match kind:
        case "sphere":
            return SphereBody(kind="sphere", radius_m=0.2, **common)
        case "endless":
            return CylinderBody(kind="cylinder", radius_m=0.15, axis=axis, **common)
        case "cylinder":
            return CylinderBody(kind="cylinder", radius_m=0.15, length_m=0.5, axis=axis, **common)
        case "capsule":
            return CapsuleBody(kind="capsule", radius_m=0.12, length_m=0.3, axis=axis, **common)
        case "box":
            return BoxBody(kind="box", size_m=(0.3, 0.2, 0.4), rotation_deg=turn, **common)
        case _:
            return MeshBody(kind="mesh", path=BUNNY, size_m=0.6, rotation_deg=turn, resolution=24, **common)


@settings(max_examples=60, deadline=None)
@given(kind=st.sampled_from(KINDS), centre=places, turn=turns, velocity=places, spin=turns, time_s=st.floats(0.0, 1.0))
def test_kernels_draw_what_numpy_sees(
    kind: str, centre: tuple, turn: tuple, velocity: tuple, spin: tuple, time_s: float, request: pytest.FixtureRequest
) -> None:
    body = body_of(kind, centre, turn, RigidMotion(kind="rigid", velocity_m_s=velocity, spin_deg_s=spin))
    field = draw(body, device=request.config.getoption("--device"))
    assert field.moving
    field.update(time_s)
    assert_drawn(field, body, time_s)


@pytest.mark.parametrize("kind", KINDS)
def test_resting_bodies_are_drawn_at_once(kind: str, device: str) -> None:
    body = body_of(kind, (0.1, -0.05, 0.0), (30.0, 40.0, 10.0), None)
    field = draw(body, device=device)
    assert not field.moving and field.solid.numpy().any()
    assert_drawn(field, body, 0.0)


@pytest.mark.parametrize(
    ("kind", "volume_m3"),
    [
        ("sphere", 4 / 3 * np.pi * 0.2**3),
        ("cylinder", np.pi * 0.15**2 * 0.5),
        ("capsule", np.pi * 0.12**2 * 0.3 + 4 / 3 * np.pi * 0.12**3),
        ("box", 0.3 * 0.2 * 0.4),
    ],
)
def test_fractions_add_up_to_the_volume(kind: str, volume_m3: float, device: str) -> None:
    field = draw(body_of(kind, (0.02, 0.01, 0.0), (30.0, 50.0, -20.0), None), device=device)
    drawn = field.fraction.numpy().sum(dtype=np.float64) * DENSITY.voxel_size_m**3
    assert drawn == pytest.approx(volume_m3, rel=0.02)


def test_a_spinning_body_carries_its_walls_round(device: str) -> None:
    """omega about z through a centre off the origin: u = omega (-y, x), checked cell by cell with plain numbers."""
    motion = RigidMotion(kind="rigid", velocity_m_s=(0.0, 0.0, 0.5), spin_deg_s=(0.0, 0.0, 90.0))
    wheel = CylinderBody(kind="cylinder", centre_m=(0.1, -0.05, 0.0), radius_m=0.2, length_m=0.3, motion=motion)
    field = draw(wheel, device=device)
    z, y, x = np.nonzero(field.solid.numpy())
    per_step = np.pi / 2 * UNITS.dt_s
    i, j = (np.array((0.1, -0.05)) - VELOCITY.origin_m[:2]) / VELOCITY.voxel_size_m + 0.5
    u = field.wall_velocity.numpy()[z, y, x]
    assert len(z) > 100
    assert np.allclose(u[:, 0], -per_step * (y - j), atol=1e-6)
    assert np.allclose(u[:, 1], per_step * (x - i), atol=1e-6)
    assert np.allclose(u[:, 2], 0.5 * UNITS.dt_s / UNITS.dx_m, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_moving_body_leaves_no_trace_and_equals_the_shifted_one(kind: str, device: str) -> None:
    cells = 3 * VELOCITY.voxel_size_m
    motion = Keyframes(kind="keyframes", times_s=(0.0, 1.0), offsets_m=((0.0, 0.0, 0.0), (cells, -cells, 0.0)))
    turn = (20.0, 30.0, 0.0)
    moving = draw(body_of(kind, (-0.1, 0.1, 0.0), turn, motion), device=device)
    for time_s in (0.3, 0.8, 0.2, 1.0):
        moving.update(time_s)
    shifted = draw(body_of(kind, (-0.1 + cells, 0.1 - cells, 0.0), turn, None), device=device)
    assert np.array_equal(moving.solid.numpy(), shifted.solid.numpy())
    assert np.allclose(moving.fraction.numpy(), shifted.fraction.numpy(), atol=2e-5)
    assert not moving.wall_velocity.numpy().any()  # it has come to rest


def test_what_a_moving_body_uncovers_comes_back(device: str) -> None:
    resting = [
        body_of("cylinder", (0.0, 0.0, 0.0), (0.0, 90.0, 0.0), None),
        body_of("mesh", (0.1, 0.1, 0.1), (0,) * 3, None),
    ]
    path = ((0.0, 0.0, 0.0), (0.6, 0.1, 0.0), (5.0, 5.0, 5.0))
    motion = Keyframes(kind="keyframes", times_s=(0.0, 1.0, 2.0), offsets_m=path, between="straight")
    passing = [
        body_of("sphere", (-0.3, 0.0, 0.0), (0,) * 3, motion),
        body_of("box", (-0.2, 0.1, 0.0), (0,) * 3, motion),
    ]
    alone, field = draw(*resting, device=device), draw(*resting[:1], *passing, *resting[1:], device=device)
    assert not np.array_equal(field.solid.numpy(), alone.solid.numpy())
    for time_s in np.linspace(0.0, 1.0, 7):
        field.update(float(time_s))
        over = field.wall_velocity.numpy().any(axis=-1)
        assert np.all(field.solid.numpy()[over] == 1)  # the moving ones cover those at rest
        assert np.all(field.solid.numpy() >= alone.solid.numpy())
    field.update(2.0)  # far outside
    for name in ("solid", "wall_velocity", "fraction"):
        assert np.array_equal(getattr(field, name).numpy(), getattr(alone, name).numpy())


def test_threads_change_no_byte(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sixway.sim.bodies.voxelise._WORTH_THREADS", 0)
    motion = RigidMotion(kind="rigid", velocity_m_s=(0.1, 0.1, 0.0), spin_deg_s=(20.0, 70.0, 0.0))
    bodies = [body_of(kind, (0.0, 0.05, 0.0), (10.0, 0.0, 20.0), motion) for kind in KINDS]
    one, two = draw(*bodies, device=device), draw(*bodies, device=device, threads=2)
    for field in (one, two):
        field.update(0.7)
    for name in ("solid", "wall_velocity", "fraction"):
        assert np.array_equal(getattr(one, name).numpy(), getattr(two, name).numpy())


def test_a_sphere_of_triangles_is_a_sphere(tmp_path: Path, device: str) -> None:
    import trimesh

    trimesh.creation.icosphere(subdivisions=4, radius=7.0).export(tmp_path / "ball.stl")
    motion = RigidMotion(kind="rigid", velocity_m_s=(0.1, 0.0, 0.0), spin_deg_s=(50.0, 70.0, 0.0))
    mesh = MeshBody(kind="mesh", path=str(tmp_path / "ball.stl"), centre_m=(0.0, 0.05, 0.0), size_m=0.5, motion=motion)
    ball = SphereBody(kind="sphere", centre_m=(0.0, 0.05, 0.0), radius_m=0.25, motion=motion)
    drawn, exact = draw(mesh, device=device), draw(ball, device=device)
    for field in (drawn, exact):
        field.update(0.9)
    assert np.abs(drawn.fraction.numpy() - exact.fraction.numpy()).max() < 0.05
    distance = ball.signed_distance(centres(VELOCITY, shell=1), 0.9) / VELOCITY.voxel_size_m
    differ = drawn.solid.numpy() != exact.solid.numpy()
    assert np.all(np.abs(distance[differ]) < 0.05)


def test_no_bodies_mean_nothing_solid(device: str) -> None:
    field = draw(device=device)
    assert not field.moving
    field.update(1.0)
    assert not field.solid.numpy().any() and not field.fraction.numpy().any()
    assert field.solid.shape == tuple(n + 2 for n in VELOCITY.shape_zyx)
    assert field.fraction.shape == DENSITY.shape_zyx
