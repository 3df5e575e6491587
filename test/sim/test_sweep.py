"""One simulated sweep."""

import numpy as np
import pytest

from tactile_localizer.sim import simulate_recording, simulate_sweep

FIELDS = ("stamp_ns", "truth", "position", "strain")


def test_sweeps_are_reproducible():
    first = simulate_sweep("bump", 1, 4)
    simulate_sweep("bump", 1, 3)
    again = simulate_sweep("bump", 1, 4)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    other = simulate_sweep("bump", 2, 4)
    assert len(other.strain) != len(first.strain) or not np.allclose(other.strain, first.strain)


def test_stamps_follow_the_rate():
    sweeps = [simulate_sweep("bump", 1, number, rate=50.0) for number in (0, 1)]
    assert set(np.diff(sweeps[0].stamp_ns)) == {20_000_000}
    assert sweeps[0].stamp_ns[0] > 0
    assert sweeps[1].stamp_ns[0] > sweeps[0].stamp_ns[-1]


def test_contact_brackets_the_signal():
    sweep = simulate_sweep("bump", 1, 0, start=(0.0, 0.0134))
    level = np.median(sweep.strain[~sweep.felt], axis=0)
    assert np.max(np.abs(sweep.strain[~sweep.felt] - level)) < 0.15
    assert np.max(np.abs(sweep.strain[sweep.felt] - level)) > 0.3
    first, last = sweep.truth[list(sweep.contact), 0]
    assert 0.015 < first < 0.026
    assert 0.038 < last < 0.048
    assert sweep.felt.sum() == np.ptp(sweep.contact) + 1


@pytest.mark.parametrize(
    ("y", "finger", "other"), [(0.0134, slice(0, 8), slice(8, 16)), (0.0374, slice(8, 16), slice(0, 8))]
)
def test_only_the_finger_over_the_feature_responds(y, finger, other):
    sweep = simulate_sweep("snap", 3, 0, start=(0.0, y))
    signal = np.ptp(sweep.strain, axis=0)
    assert np.max(signal[finger]) > 0.5
    assert np.max(signal[other]) < 0.35 * np.max(signal[finger])


def test_featureless_sweeps_have_no_contact():
    for sweep in (
        simulate_sweep("none", 1, 0, start=(0.0, 0.0134)),
        simulate_sweep("bump", 1, 0, start=(0.0, 0.0134), end=(0.014, 0.0134)),
        *simulate_recording("bump", 1, "test", sweeps=4, reach_feature=False).sweeps,
    ):
        assert not sweep.felt.any()


def test_sweeps_may_have_any_direction():
    sweep = simulate_sweep("bump", 1, 0, start=(0.05, 0.04), end=(0.01, 0.0))
    np.testing.assert_allclose(sweep.truth[0], (0.05, 0.04), atol=1e-3)
    np.testing.assert_allclose(sweep.truth[-1], (0.01, 0.0), atol=4e-3)
