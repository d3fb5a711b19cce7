"""Bodies by their signed distance, in NumPy."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sixway.core.config import Config, ConfigError, dump_config, load_config, parse_config
from sixway.core.frames import Grid
from sixway.sim.bodies.motion import RigidMotion
from sixway.sim.bodies.shapes import (
    Body,
    BoxBody,
    CapsuleBody,
    CylinderBody,
    MeshBody,
    ObstacleConfig,
    SphereBody,
    check_bodies,
    nearest_approach,
    surface_speed_m_s,
)
from sixway.sim.units import LatticeUnits

BUNNY = Path(__file__).parents[3] / "configs" / "sim" / "meshes" / "bunny.ply"
ORIGIN = (0.0, 0.0, 0.0)
GRID = Grid.centred((32, 32, 32))
UNITS = LatticeUnits(dx_m=1 / 32, dt_s=0.1 / 32)  # 1 m/s is 0.1 cells/step


class Scene(Config):
    obstacles: tuple[ObstacleConfig, ...]


def parse(**values: object) -> Body:
    return parse_config(Scene, {"obstacles": [values]}, source="test").obstacles[0]


def bodies(centre: tuple[float, float, float] = ORIGIN, turn: tuple[float, float, float] = ORIGIN) -> list[Body]:
    axis = tuple(Rotation.from_rotvec(turn, degrees=True).apply([0.0, 0.0, 1.0]).clip(-1.0, 1.0).tolist())
    return [
        SphereBody(kind="sphere", centre_m=centre, radius_m=0.2),
        CylinderBody(kind="cylinder", centre_m=centre, radius_m=0.15, axis=axis),
        CylinderBody(kind="cylinder", centre_m=centre, radius_m=0.15, length_m=0.4, axis=axis),
        CapsuleBody(kind="capsule", centre_m=centre, radius_m=0.12, length_m=0.3, axis=axis),
        BoxBody(kind="box", centre_m=centre, size_m=(0.3, 0.2, 0.4), rotation_deg=turn),
    ]


@pytest.mark.parametrize(
    ("body", "volume_m3"),
    zip(bodies(turn=(20.0, 50.0, -35.0)), [
        4 / 3 * np.pi * 0.2**3,
        None,
        np.pi * 0.15**2 * 0.4,
        np.pi * 0.12**2 * 0.3 + 4 / 3 * np.pi * 0.12**3,
        0.3 * 0.2 * 0.4,
    ], strict=True),
    ids=["sphere", "endless", "cylinder", "capsule", "box"],
)  # fmt: skip
def test_volumes_are_the_textbook_ones(body: Body, volume_m3: float | None) -> None:
    n = 80
    centre = (np.arange(n) + 0.5) / n - 0.5
    points = np.stack(np.meshgrid(centre, centre, centre, indexing="ij"), axis=-1)
    inside = np.clip(0.5 - body.signed_distance(points) * n, 0.0, 1.0).mean()
    if volume_m3 is None:  # the length of its axis within a box is not the textbook's
        volume_m3 = parse(kind="cylinder", centre_m=[0.0] * 3, radius_m=0.15, length_m=100.0, axis=list(body.axis))
        volume_m3 = np.clip(0.5 - volume_m3.signed_distance(points) * n, 0.0, 1.0).mean()
    assert inside == pytest.approx(volume_m3, rel=5e-3)


def test_distances_at_points_worked_out_by_hand() -> None:
    at = np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.5], [0.5, 0.0, 0.6], [0.0, 0.0, 0.0]])
    cylinder = parse(kind="cylinder", centre_m=[0.0] * 3, radius_m=0.2, length_m=0.4)
    assert np.allclose(cylinder.signed_distance(at), [0.3, 0.3, 0.5, -0.2])
    capsule = parse(kind="capsule", centre_m=[0.0] * 3, radius_m=0.2, length_m=0.4)
    assert np.allclose(capsule.signed_distance(at), [0.3, 0.1, np.hypot(0.5, 0.4) - 0.2, -0.2])
    box = parse(kind="box", centre_m=[0.0] * 3, size_m=[0.4, 2.0, 0.6], rotation_deg=[0.0, 90.0, 0.0])
    assert np.allclose(box.signed_distance(at), [0.2, 0.3, np.hypot(0.2, 0.4), -0.2])


def test_todays_scenes_keep_their_meaning(tmp_path: Path) -> None:
    (tmp_path / "old.yaml").write_text(
        "obstacles:\n"
        "  - {kind: cylinder, axis: x, centre_m: [0.04, -0.1, 0.3], radius_m: 0.1}\n"
        "  - {kind: sphere, centre_m: [0.06, -0.05, 0.0], radius_m: 0.13}\n"
        "  - {kind: cylinder, centre_m: [0.04, -0.1, 0.0], radius_m: 0.1}\n"
    )
    across, ball, default = load_config(Scene, tmp_path / "old.yaml").obstacles
    assert across.signed_distance(np.array([[50.0, 0.2, 0.3]])) == pytest.approx(0.2)
    assert ball.signed_distance(np.array([[0.06, -0.05, 1.0]])) == pytest.approx(0.87)
    assert default.signed_distance(np.array([[0.34, 0.3, -70.0]])) == pytest.approx(0.4)
    assert across.motion is None


angles = st.tuples(*[st.floats(-180.0, 180.0)] * 3)
places = st.tuples(*[st.floats(-0.5, 0.5)] * 3)


@settings(max_examples=40, deadline=None)
@given(turn=angles, centre=places, seed=st.integers(0, 99))
def test_distances_do_not_depend_on_the_pose(turn: tuple, centre: tuple, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (50, 3))
    rotation = Rotation.from_rotvec(turn, degrees=True)
    turned = zip(bodies(), bodies(centre, turn), strict=True)
    for still, moved in turned:
        assert np.allclose(still.signed_distance(points), moved.signed_distance(rotation.apply(points) + centre))


@settings(max_examples=40, deadline=None)
@given(turn=angles, spin=angles, seed=st.integers(0, 99))
def test_no_distance_changes_faster_than_the_way_gone_and_bounds_hold(turn: tuple, spin: tuple, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-0.6, 0.6, (2, 200, 3))
    for body in bodies(turn=turn):
        moving = body.model_copy(update={"motion": RigidMotion(kind="rigid", spin_deg_s=spin)})
        change = np.abs(moving.signed_distance(a, 0.7) - moving.signed_distance(b, 0.7))
        assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-9)
        low, high = moving.bounds_m(0.7)
        within = a[moving.signed_distance(a, 0.7) < 0.0]
        assert np.all((within > low) & (within < high))


def test_bounds_are_no_larger_than_they_must_be() -> None:
    slanted = CylinderBody(kind="cylinder", centre_m=ORIGIN, radius_m=0.3, length_m=0.8, axis=(0.0, 1.0, 1.0))
    low, high = slanted.bounds_m(0.0)
    assert np.allclose(high, [0.3, 0.7 / np.sqrt(2), 0.7 / np.sqrt(2)]) and np.allclose(low, -high)
    capsule = CapsuleBody(kind="capsule", centre_m=ORIGIN, radius_m=0.3, length_m=0.8, axis=(0.0, 1.0, 1.0))
    assert np.allclose(capsule.bounds_m(0.0)[1], [0.3, 0.3 + 0.4 / np.sqrt(2), 0.3 + 0.4 / np.sqrt(2)])
    spinning = RigidMotion(kind="rigid", spin_deg_s=(0.0, 45.0, 0.0))
    assert np.allclose(SphereBody(kind="sphere", centre_m=ORIGIN, radius_m=0.3, motion=spinning).bounds_m(1.0)[1], 0.3)


def test_a_moving_body_is_the_resting_one_elsewhere(rng: np.random.Generator) -> None:
    points = rng.uniform(-0.5, 0.5, (100, 3))
    motion = RigidMotion(kind="rigid", velocity_m_s=(0.1, 0.2, -0.05), spin_deg_s=(0.0, 0.0, 30.0))
    moving = BoxBody(kind="box", centre_m=ORIGIN, size_m=(0.3, 0.2, 0.4), motion=motion)
    there = BoxBody(kind="box", centre_m=(0.2, 0.4, -0.1), size_m=(0.3, 0.2, 0.4), rotation_deg=(0.0, 0.0, 60.0))
    assert np.allclose(moving.signed_distance(points, 2.0), there.signed_distance(points))


def test_the_nearest_approach_is_found_with_its_time() -> None:
    motion = RigidMotion(kind="rigid", velocity_m_s=(0.0, -0.1, 0.0))
    falling = SphereBody(kind="sphere", centre_m=(0.0, 0.4, 0.0), radius_m=0.1, motion=motion)
    resting = SphereBody(kind="sphere", centre_m=(0.4, 0.0, 0.0), radius_m=0.1)
    inlet = np.array([[0.0, -0.5, 0.0], [0.1, -0.5, 0.0]])
    times = np.linspace(0.0, 6.0, 13).tolist()
    gap, when = nearest_approach([falling, resting], inlet, times_s=times, within_m=0.5)
    assert (gap, when) == (pytest.approx(0.2), 6.0)
    assert nearest_approach([resting], inlet, times_s=times, within_m=0.1) == (np.inf, 0.0)
    assert nearest_approach([], inlet, times_s=times, within_m=0.1) == (np.inf, 0.0)


def test_the_speed_of_a_spinning_surface() -> None:
    motion = RigidMotion(kind="rigid", velocity_m_s=(1.0, 0.0, 0.0), spin_deg_s=(0.0, 0.0, 180.0))
    bar = BoxBody(kind="box", centre_m=ORIGIN, size_m=(0.6, 0.8, 0.1), motion=motion)
    # the corner (-0.3, -0.4) turns with pi (0.4, -0.3)
    assert surface_speed_m_s(bar, 0.0, within_m=9.0) == pytest.approx(np.hypot(1 + 0.4 * np.pi, 0.3 * np.pi))


def moving_sphere(**motion: object) -> Body:
    return parse(kind="sphere", centre_m=[0.0] * 3, radius_m=0.1, motion={"kind": "rigid", **motion})


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (moving_sphere(velocity_m_s=[0.0, 0.3, 0.0]), r"obstacles.1: lies outside the box at 2 s.*\(0, 0.6, 0\)"),
        (parse(kind="sphere", centre_m=[0.0, 2.0, 0.0], radius_m=0.1), "outside the box at 0 s.*move it in"),
        (parse(kind="sphere", centre_m=[0.0] * 3, radius_m=0.04), "0.08 m thick, below 3 velocity cells.*at least"),
        (moving_sphere(velocity_m_s=[0.0, 0.0, 3.0]), "0.3 cells/step at 0 s; at most 0.25.*slow it down 1.2 times"),
        (moving_sphere(spin_deg_s=[0.0, 0.0, 3600.0]), "cells/step at 0 s.*slow it down"),
    ],
)
def test_bodies_that_the_grid_cannot_carry_are_refused(body: Body, told: str) -> None:
    fits = BoxBody(kind="box", centre_m=(0.4, 0.4, 0.4), size_m=(0.3, 0.3, 0.3))  # it crosses the walls
    times = np.linspace(0.0, 4.0, 9).tolist()
    check_bodies([fits], grid=GRID, units=UNITS, times_s=times)
    with pytest.raises(ValueError, match=told):
        check_bodies([fits, body], grid=GRID, units=UNITS, times_s=times)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"kind": "cone"}, "cylinder.*sphere.*box.*capsule.*mesh"),
        ({"kind": "sphere", "radius_m": 0.0}, "radius_m.*greater than 0"),
        ({"kind": "capsule", "radius_m": 0.1}, "length_m: this key is required"),
        ({"kind": "cylinder", "radius_m": 0.1, "axis": [0.0, 0.0, 0.0]}, "no length; give it a component"),
        ({"kind": "cylinder", "radius_m": 0.1, "axis": "up"}, "axis"),
        ({"kind": "box", "size_m": [0.1, 0.1]}, "size_m"),
        ({"kind": "sphere", "radius_m": 0.1, "velocity_m_s": [0.0] * 3}, "unknown key"),
        ({"kind": "mesh", "path": "none.ply", "size_m": 0.1}, "none.ply: there is no such mesh file"),
        ({"kind": "mesh", "path": "scene.blend", "size_m": 0.1}, "ends in one of .obj, .stl, .ply; convert"),
        ({"kind": "sphere", "radius_m": 0.1, "motion": {"kind": "keyframes", "times_s": [1.0, 0.0]}}, "must rise"),
    ],
)
def test_a_bad_body_is_told_value_rule_and_remedy(values: dict, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse(centre_m=[0.0] * 3, **values)


def test_a_mesh_is_found_from_its_config_and_comes_back_from_its_dump(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "bunny.ply").write_bytes(BUNNY.read_bytes())
    path = tmp_path / "scene.yaml"
    path.write_text("obstacles: [{kind: mesh, path: meshes/bunny.ply, centre_m: [0.0, 0.1, 0.0], size_m: 0.5}]")
    scene = load_config(Scene, path)
    assert Path(scene.obstacles[0].path) == tmp_path / "meshes" / "bunny.ply"
    (tmp_path / "dumped.yaml").write_text(dump_config(scene))
    assert load_config(Scene, tmp_path / "dumped.yaml") == scene
    assert parse_config(Scene, scene.model_dump(mode="json"), source="dump") == scene


@pytest.mark.parametrize(("up", "ear_tip"), [("x", (-1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, -1))])
def test_the_up_axis_of_a_mesh_points_up(up: str, ear_tip: tuple) -> None:
    """The file's y is where the bunny's ears point: it lies down unless that is said."""
    body = MeshBody(kind="mesh", path=str(BUNNY), centre_m=ORIGIN, size_m=1.0, up=up)
    assert np.allclose(body.rest_rotation @ [0.0, 1.0, 0.0], ear_tip, atol=1e-12)
    along = {"x": 0, "y": 1, "z": 2}[up]
    assert np.allclose(body.rest_rotation[:, along], [0.0, 1.0, 0.0], atol=1e-12)
    low, high = body.bounds_m(0.0)
    tallest = np.argmax(np.abs(ear_tip))
    assert (high - low)[tallest] == pytest.approx(1.0) and np.argmax(high - low) == tallest


def test_a_mesh_turns_about_the_centre_of_its_bounds() -> None:
    body = MeshBody(kind="mesh", path=str(BUNNY), centre_m=(0.2, 0.1, 0.0), size_m=0.5, rotation_deg=(0.0, 180.0, 0.0))
    low, high = body.bounds_m(0.0)
    assert np.allclose(0.5 * (low + high), [0.2, 0.1, 0.0])
    assert np.allclose(0.5 * (high - low), body.half_extent_m)
    chest = np.array([[0.2, 0.0, 0.0]])
    assert body.signed_distance(chest)[0] < 0.0 < body.signed_distance(chest + np.array([0.0, 0.0, 0.3]))[0]
