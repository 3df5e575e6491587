"""Stamps that go back are late, or begin another run."""

import numpy as np

from tactile_localizer.streams.runs import LATE, runs_of


def test_a_stamp_is_late_by_half_a_second_at_most():
    seconds = np.array([0.0, 1.0, 1.0, 0.5, 1.2, 0.6999, 0.8, 0.2, 0.3])
    np.testing.assert_array_equal(runs_of((seconds * 1e9).astype(int)), [0, 0, LATE, LATE, 0, 1, 1, 2, 2])
