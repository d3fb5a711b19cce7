"""Poses of moving bodies and their velocities."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sixway.core.config import Config, ConfigError, parse_config
from sixway.sim.bodies.motion import Keyframes, Motion, Pose, RigidMotion, left_jacobian


class Moved(Config):
    motion: Motion


def parse(**values: object) -> RigidMotion | Keyframes:
    return parse_config(Moved, {"motion": values}, source="test").motion


def rates(motion: RigidMotion | Keyframes, time_s: float, step_s: float = 1e-5) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and angular velocity by central differences of the pose."""
    before, after = motion.pose(time_s - step_s), motion.pose(time_s + step_s)
    turned = Rotation.from_matrix(after.rotation @ before.rotation.T).as_rotvec()
    return (after.offset_m - before.offset_m) / (2 * step_s), turned / (2 * step_s)


def same(a: Pose, b: Pose) -> bool:
    return np.allclose(a.offset_m, b.offset_m, atol=1e-9) and np.allclose(a.rotation, b.rotation, atol=1e-9)


def test_rigid_motion_goes_straight_and_turns_steadily() -> None:
    pose = parse(kind="rigid", velocity_m_s=[1.0, 0.0, -0.5], spin_deg_s=[0.0, 90.0, 0.0]).pose(2.0)
    assert np.allclose(pose.offset_m, [2.0, 0.0, -1.0])
    assert np.allclose(pose.rotation @ [1.0, 2.0, 3.0], [-1.0, 2.0, -3.0])  # half a turn about y
    assert np.allclose(pose.velocity_m_s, [1.0, 0.0, -0.5])
    assert np.allclose(pose.spin_rad_s, [0.0, np.pi / 2, 0.0])


def test_a_quarter_turn_is_counter_clockwise_seen_from_the_tip() -> None:
    pose = parse(kind="rigid", spin_deg_s=[0.0, 0.0, 90.0]).pose(1.0)
    assert np.allclose(pose.rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


triple = st.tuples(*[st.floats(-200.0, 200.0)] * 3)
offset = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.floats(0.2, 2.0), min_size=2, max_size=5),
    data=st.data(),
    between=st.sampled_from(["smooth", "straight"]),
    part=st.floats(0.01, 0.99),
)
def test_velocities_are_the_derivative_of_the_pose(steps: list, data: st.DataObject, between: str, part: float) -> None:
    times = np.cumsum([0.0, *steps])
    keys = len(times)
    motion = Keyframes(
        kind="keyframes",
        times_s=tuple(times.tolist()),
        offsets_m=tuple(data.draw(st.lists(offset, min_size=keys, max_size=keys))),
        turns_deg=tuple(data.draw(st.lists(triple, min_size=keys, max_size=keys))),
        between=between,
    )
    time_s = float(part * times[-1])
    if np.abs(times - time_s).min() < 1e-3:
        time_s += 2e-3  # straight paths have corners at their keys
    pose, (velocity, spin) = motion.pose(time_s), rates(motion, time_s)
    assert np.allclose(pose.velocity_m_s, velocity, atol=1e-4)
    assert np.allclose(pose.spin_rad_s, spin, atol=1e-3)
    assert np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("between", ["smooth", "straight"])
def test_keyframes_pass_their_keys_and_rest_outside(between: str) -> None:
    offsets, turns = [[0, 0, 0], [1, 2, 0], [1, 0, 1.0]], [[0, 0, 0], [0, 30, 0], [0, 400, 0.0]]
    motion = parse(kind="keyframes", times_s=[1.0, 2.0, 4.0], offsets_m=offsets, turns_deg=turns, between=between)
    for time_s, offset_m, turn in zip([1.0, 2.0, 4.0], offsets, turns, strict=True):
        pose = motion.pose(time_s)
        assert np.allclose(pose.offset_m, offset_m)
        assert np.allclose(pose.rotation, Rotation.from_rotvec(turn, degrees=True).as_matrix())
    for time_s, key in ((0.0, 1.0), (9.0, 4.0)):
        assert same(motion.pose(time_s), motion.pose(key))
        assert not motion.pose(time_s).velocity_m_s.any() and not motion.pose(time_s).spin_rad_s.any()


def test_a_smooth_path_keeps_a_steady_motion_and_starts_from_rest() -> None:
    steady = [[float(n), 0.0, 0.0] for n in range(6)]
    motion = parse(kind="keyframes", times_s=[0.0, 1.0, 2.0, 3.0, 4.0, 5.0], offsets_m=steady)
    for time_s in (1.5, 2.0, 3.25):  # Catmull-Rom reproduces straight lines
        assert np.allclose(motion.pose(time_s).offset_m, [time_s, 0.0, 0.0])
        assert np.allclose(motion.pose(time_s).velocity_m_s, [1.0, 0.0, 0.0])
    assert np.allclose(motion.pose(1e-6).velocity_m_s, 0.0, atol=1e-4)


def test_a_loop_comes_round_with_its_velocity() -> None:
    turns = [[0.0, 0.0, 120.0 * n] for n in range(4)]
    motion = parse(kind="keyframes", times_s=[1.0, 2.0, 3.0, 4.0], turns_deg=turns, after="loop")
    assert same(motion.pose(1.7), motion.pose(4.7)) and same(motion.pose(3.5), motion.pose(0.5))
    for time_s in (1.0, 2.6, 4.0 - 1e-9, 8.0):
        assert np.allclose(motion.pose(time_s).spin_rad_s, [0.0, 0.0, np.deg2rad(120.0)])


def test_the_jacobian_is_smooth_at_no_turn() -> None:
    assert np.allclose(left_jacobian(np.array([0.0, 2e-8, 0.0])), left_jacobian(np.zeros(3)), atol=1e-7)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"kind": "keyframes", "times_s": [0.0, 1.0], "offsets_m": [[0, 0, 0.0]]}, "1 entries for 2 times_s; give one"),
        ({"kind": "keyframes", "times_s": [1.0, 1.0]}, "must rise.*1.0 before 1.0; sort"),
        ({"kind": "keyframes", "times_s": [1.0]}, "times_s.*at least 2"),
        ({"kind": "keyframes", "times_s": [0.0, 1.0], "offsets_m": [[0, 0, 0.0], [1, 0, 0.0]], "after": "loop"},
         "1 m and 0 degrees away.*repeat the first key"),
        ({"kind": "keyframes", "times_s": [0.0, 1.0], "turns_deg": [[0, 0, 0.0], [0, 90, 0.0]], "after": "loop"},
         "0 m and 90 degrees"),
        ({"kind": "keyframes", "times_s": [0.0, float("nan")]}, "times_s"),
        ({"kind": "rigid", "speed": 1.0}, "unknown key"),
        ({"kind": "wobble"}, "rigid.*keyframes"),
    ],
)  # fmt: skip
def test_a_bad_motion_is_told_value_rule_and_remedy(values: dict, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse(**values)
