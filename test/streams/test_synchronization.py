"""Palm positions are interpolated at the stamps of strain vectors."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.scene import Axis
from tactile_localizer.streams.synchronization import (
    interpolate_pose,
    interpolate_poses,
    near_bounds,
)

AXES = (Axis("x", 0.0, 1.0),)
MS = 1_000_000


def interpolated(axes, poses, *stamps_ms):
    pose_ns = np.array([round(stamp_s * 1e9) for stamp_s, _ in poses], dtype=np.int64)
    positions = np.array([position for _, position in poses], dtype=float).reshape(-1, len(axes))
    return interpolate_poses(axes, pose_ns, positions, np.array(stamps_ms) * MS)[0]


def test_yaw_follows_the_shortest_arc_near_its_bounds():
    poses = [(1.0, (3.1,)), (1.1, (-3.1,))]
    yaw, beyond = Axis("yaw", -math.pi, math.pi), Axis("yaw", 3.0, 3.5)
    np.testing.assert_allclose(np.abs(interpolated((yaw,), poses, 1050)), math.pi)
    np.testing.assert_allclose(interpolated((beyond,), poses, 1100), math.tau - 3.1)


def test_no_position_outside_the_poses_or_in_a_gap_but_at_its_ends():
    poses = [(1.0, (0.1,)), (1.1, (0.2,)), (1.3, (0.4,))]
    found = interpolated(AXES, poses, 999, 1000, 1050, 1100, 1200, 1300, 1301)[:, 0]
    np.testing.assert_allclose(found, [math.nan, 0.1, 0.15, 0.2, math.nan, 0.4, math.nan])
    assert np.isnan(interpolated(AXES, [], 1000)).all()


@given(
    poses=st.dictionaries(st.integers(0, 400), st.tuples(st.floats(0, 1), st.floats(-3.2, 3.2)), max_size=9),
    stamps_ms=st.lists(st.integers(-50, 450), min_size=1, max_size=20),
)
def test_one_stamp_and_many_have_the_same_positions(poses, stamps_ms):
    axes, poses = (*AXES, Axis("yaw", -3.0, 0.5)), sorted(poses.items())
    pose_ns, positions = [at * MS for at, _ in poses], [np.array(place) for _, place in poses]
    each = [interpolate_pose(axes, pose_ns, positions, at * MS) for at in stamps_ms]
    expected = interpolated(axes, [(at / 1000, place) for at, place in poses], *stamps_ms)
    np.testing.assert_array_equal([np.full(2, math.nan) if p is None else p for p in each], expected)


def test_near_bounds_moves_yaw_by_whole_turns():
    axes = (*AXES, Axis("yaw", -0.5, 0.5))
    given_positions = np.array([[0.1, 6.0], [0.2, -6.5], [0.3, 0.4]])
    moved = near_bounds(axes, given_positions)
    np.testing.assert_allclose(moved[:, 1], [6.0 - math.tau, -6.5 + math.tau, 0.4])
    np.testing.assert_array_equal(given_positions[:, 1], [6.0, -6.5, 0.4])
    assert near_bounds(AXES, given_positions) is given_positions
