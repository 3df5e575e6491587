"""An estimate as a pose with covariance."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_localizer.ros.publishers.estimates import pose


def test_yaw_is_a_turn_about_z_with_its_covariance():
    covariance = np.array([[4e-6, 1e-5], [1e-5, 0.01]])
    estimate = SimpleNamespace(stamp_ns=1_500_000_000, mean=np.array([0.02, 0.6]), covariance=covariance)
    message = pose(estimate, ("x", "yaw"), "material")
    turn, place = message.pose.pose.orientation, message.pose.pose.position
    assert (turn.x, turn.y) == (0.0, 0.0)
    assert 2.0 * np.arctan2(turn.z, turn.w) == pytest.approx(0.6)
    assert (place.x, place.y, message.header.stamp.nanosec) == (0.02, 0.0, 500_000_000)
    found = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_array_equal(found[np.ix_([0, 5], [0, 5])], covariance)
