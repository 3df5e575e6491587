"""Palm poses are interpolated at the stamps of strain vectors."""

import math

import numpy as np
import pytest

from tactile_localizer.core.geometry.pose_buffer import PoseBuffer, near_bounds
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis

X = Axis("x", 0.0, 1.0)
Y = Axis("y", 0.0, 1.0)
YAW = Axis("yaw", -math.pi, math.pi)
SECOND = 1_000_000_000


def buffer_of(axes, *poses, **options) -> PoseBuffer:
    buffer = PoseBuffer(axes, **options)
    for stamp_s, position in poses:
        buffer.add(round(stamp_s * SECOND), np.array(position))
    return buffer


def test_positions_are_interpolated_linearly():
    buffer = buffer_of((X, Y), (1.00, (0.1, 0.5)), (1.04, (0.3, 0.1)))
    np.testing.assert_allclose(buffer.at(1_010_000_000), [0.15, 0.4])


def test_a_pose_beside_a_gap_is_returned_at_its_stamp():
    buffer = buffer_of((X,), (1.0, (0.1,)), (2.0, (0.3,)), (3.0, (0.7,)))
    assert buffer.at(2 * SECOND) == 0.3
    assert buffer.at(1 * SECOND) == 0.1


def test_yaw_follows_the_shortest_arc_near_its_bounds():
    buffer = buffer_of((YAW,), (1.0, (3.1,)), (1.1, (-3.1,)))
    np.testing.assert_allclose(np.abs(buffer.at(1_050_000_000)), math.pi)
    beyond = Axis("yaw", 3.0, 3.5)
    buffer = buffer_of((beyond,), (1.0, (3.1,)), (1.1, (-3.1,)))
    np.testing.assert_allclose(buffer.at(1_100_000_000), math.tau - 3.1)


def test_no_position_outside_the_poses_or_in_a_gap():
    buffer = buffer_of((X,), (1.0, (0.1,)), (1.1, (0.2,)), (1.3, (0.4,)))
    assert buffer.at(999_999_999) is None
    assert buffer.at(1_300_000_001) is None
    assert buffer.at(1_200_000_000) is None
    assert buffer.at(1_050_000_000) is not None
    assert PoseBuffer((X,)).at(1) is None


def test_a_late_pose_is_dropped_and_a_backward_jump_clears():
    buffer = buffer_of((X,), (10.0, (0.1,)), (10.1, (0.2,)), length_s=5.0)
    assert not buffer.add(10_050_000_000, np.array([0.9]))
    assert not buffer.add(10_100_000_000, np.array([0.9]))
    np.testing.assert_allclose(buffer.at(10_050_000_000), 0.15)
    assert buffer.add(1 * SECOND, np.array([0.5]))
    assert len(buffer) == 1
    assert buffer.newest_ns == SECOND


def test_memory_is_bounded():
    buffer = PoseBuffer((X,), length_s=1.0)
    for step in range(10_000):
        buffer.add(step * 10_000_000, np.array([0.5]))
        assert len(buffer) <= 152
    assert buffer.at(buffer.newest_ns - SECOND) == 0.5


@pytest.mark.parametrize("position", [[math.nan], [math.inf], [0.1, 0.2], []])
def test_an_invalid_pose_is_refused(position):
    buffer = buffer_of((X,), (1.0, (0.1,)))
    with pytest.raises(MeasurementError, match="palm position: expected finite x, got"):
        buffer.add(2 * SECOND, np.array(position))
    assert len(buffer) == 1


def test_near_bounds_moves_yaw_by_whole_turns():
    axes = (X, Axis("yaw", -0.5, 0.5))
    given_positions = np.array([[0.1, 6.0], [0.2, -6.5], [0.3, 0.4]])
    moved = near_bounds(axes, given_positions)
    np.testing.assert_allclose(moved[:, 1], [6.0 - math.tau, -6.5 + math.tau, 0.4])
    np.testing.assert_array_equal(given_positions[:, 1], [6.0, -6.5, 0.4])
    assert near_bounds((X,), given_positions) is given_positions
