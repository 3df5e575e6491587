"""Strains and poses in any order become estimates in the order of the stamps, or are counted."""

import dataclasses

import numpy as np
import pytest
from support.sweeps import kidnapped_sweep, scene_of, unseen_sweep

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.decision.convergence import State
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.ros.localization.online_localizer import OnlineLocalizer
from tactile_localizer.sim import simulate_scan

MS = 1_000_000
WELL = np.zeros(2, dtype=np.uint8)


@pytest.fixture(scope="module")
def localizer():
    scan = simulate_scan("bump", seed=1).to_scan()
    configuration = Configuration(cell=1.0)
    calibration = Calibration(0.0033, np.array([0.0004, 0.0004]))
    return build_localizer(scan, scene_of(), configuration, np.random.default_rng(0), None, calibration)


@pytest.fixture(scope="module")
def known():
    return ScanRange.of(simulate_scan("bump", seed=1).to_scan(), scene_of())


@pytest.fixture
def tracker(localizer, known):
    localizer.reset()
    return OnlineLocalizer(localizer, max_gap_s=0.1, patience_s=1.0, ranges=(known,))


@pytest.fixture(scope="module")
def sweep():
    return unseen_sweep()


def feel(tracker, sweep, k, status=WELL):
    return tracker.add_strain(int(sweep.stamp_ns[k]) + 20 * MS, sweep.strain[k], status)


def move(tracker, sweep, k):
    return tracker.add_pose(int(sweep.stamp_ns[k]), sweep.odometry[k])


def slide(tracker, sweep, first, last):
    estimates = []
    for k in range(first, last):
        estimates += move(tracker, sweep, k) + feel(tracker, sweep, k)
    return estimates + move(tracker, sweep, last)


def test_each_strain_between_two_poses_makes_an_estimate(tracker, sweep):
    estimates = slide(tracker, sweep, 0, 20)
    assert [e.stamp_ns for e in estimates] == [int(t) + 20 * MS for t in sweep.stamp_ns[:20]]
    assert tracker.latest is estimates[-1]
    assert tracker.counts.updated + tracker.counts.moved == 20
    assert len(tracker.update_times_ns) == tracker.counts.updated == sum(e.updated for e in estimates)
    assert tracker.trouble == ""


def test_strain_waits_for_a_late_pose_and_makes_the_same_estimates(tracker, sweep):
    in_time = slide(tracker, sweep, 0, 20)
    tracker.interrupt()
    tracker.reset()
    assert [e for k in range(20) for e in feel(tracker, sweep, k)] == []
    late = [e for k in range(21) for e in move(tracker, sweep, k)]
    assert [e.stamp_ns for e in late] == [e.stamp_ns for e in in_time]
    np.testing.assert_array_equal([e.mean for e in late], [e.mean for e in in_time])


def test_strain_in_a_gap_of_the_poses_makes_no_estimate(tracker, sweep):
    slide(tracker, sweep, 0, 10)
    for k in range(10, 20):
        feel(tracker, sweep, k)
    assert [e.stamp_ns for e in move(tracker, sweep, 20)] == []
    assert tracker.counts.gaps == 10
    assert tracker.trouble == "no palm pose within 0.1 s of the strain"
    assert slide(tracker, sweep, 20, 22)
    assert tracker.trouble == ""


def test_a_phalanx_that_is_not_well_is_left_out_and_the_other_goes_on(tracker, sweep):
    for k, status in enumerate(([0, 0], [1, 0], [0, 2], [0, 4], [0, 0])):
        strain = np.where(np.repeat(status, 8), np.nan, sweep.strain[k])
        move(tracker, sweep, k)
        tracker.add_strain(int(sweep.stamp_ns[k]) + 20 * MS, strain, np.array(status, dtype=np.uint8))
    assert move(tracker, sweep, 5)
    assert tracker.counts.absent == {"index": 1, "middle": 2}
    assert tracker.counts.updated + tracker.counts.moved == 5


def test_without_any_phalanx_nothing_is_estimated(tracker, sweep):
    slide(tracker, sweep, 0, 5)
    before = tracker.latest
    feel(tracker, sweep, 5, status=np.array([1, 4], dtype=np.uint8))
    assert move(tracker, sweep, 6) == []
    assert tracker.latest is before
    assert tracker.counts.unusable == 1
    assert tracker.trouble == "no phalanx is OK"


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_strain_that_is_not_finite_is_refused_and_the_belief_is_untouched(tracker, sweep, bad):
    slide(tracker, sweep, 0, 5)
    states, weights = (array.copy() for array in tracker.localizer.hypotheses())
    sweep = dataclasses.replace(sweep, strain=sweep.strain.copy())
    sweep.strain[5, 3] = bad
    feel(tracker, sweep, 5)
    assert move(tracker, sweep, 6) == []
    assert tracker.counts.refused == 1
    assert "finite" in tracker.trouble
    np.testing.assert_array_equal(tracker.localizer.hypotheses()[0], states)
    np.testing.assert_array_equal(tracker.localizer.hypotheses()[1], weights)


def test_time_that_jumps_back_begins_anew(tracker, sweep):
    first = slide(tracker, sweep, 0, 100)
    again = slide(tracker, sweep, 0, 20)
    assert tracker.pairing.resets == 1
    np.testing.assert_array_equal([e.mean for e in again], [e.mean for e in first[:20]])
    assert tracker.age_s == pytest.approx(0.02, abs=0.03)


def test_stamps_that_leap_ahead_are_counted_and_the_belief_goes_on(tracker, sweep):
    slide(tracker, sweep, 0, 50)
    assert tracker.leaps == 0
    later = dataclasses.replace(sweep, stamp_ns=sweep.stamp_ns + 10_000_000_000)
    travel = tracker.latest.travel
    slide(tracker, later, 50, 60)
    assert tracker.leaps == 1
    assert tracker.latest.travel > travel


def test_its_age_is_how_far_the_inputs_have_gone_on_without_it(tracker, sweep):
    assert tracker.age_s == 0.0
    slide(tracker, sweep, 0, 10)
    assert tracker.age_s < 0.04
    for k in range(10, 25):
        feel(tracker, sweep, k)
    assert tracker.age_s == pytest.approx(15 * 0.04, abs=0.001)
    assert tracker.behind == "palm_pose"
    for k in range(11, 40):
        move(tracker, sweep, k)
    assert tracker.behind == "strain"


def test_after_a_reset_there_is_no_estimate_until_something_is_felt(tracker, sweep):
    slide(tracker, sweep, 0, 10)
    tracker.reset()
    assert tracker.latest is None
    (first, *_) = slide(tracker, sweep, 11, 13)
    assert first.travel == 0.0


@pytest.mark.parametrize("begin", ["reset", "seed"])
def test_what_was_felt_before_the_belief_began_anew_is_left_out_though_it_comes_later(tracker, sweep, begin):
    slide(tracker, sweep, 0, 60)
    for k in range(61, 101):
        move(tracker, sweep, k)
    since_ns = int(sweep.stamp_ns[100])
    if begin == "reset":
        tracker.reset(since_ns)
    else:
        tracker.seed(np.array([0.01, 0.03]), np.array([0.001, 0.001]), since_ns)
    assert [e for k in range(60, 100) for e in feel(tracker, sweep, k)] == []
    assert tracker.counts.earlier == 40
    (first, *_) = slide(tracker, sweep, 100, 103)
    assert first.travel == 0.0
    assert slide(tracker, sweep, 0, 5), "time was set back: what comes then is no longer earlier"


def test_a_seed_is_believed_in(tracker, sweep):
    tracker.seed(np.array([0.01, 0.03]), np.array([0.001, 0.001]))
    (first, *_) = slide(tracker, sweep, 0, 2)
    np.testing.assert_allclose(first.mean, [0.01, 0.03], atol=1e-3)


def states(estimates):
    """The states in their order, without repetitions."""
    found = [estimate.state for estimate in estimates]
    return [state for k, state in enumerate(found) if k == 0 or state is not found[k - 1]]


def test_on_other_material_the_state_becomes_unknown(tracker):
    other = unseen_sweep("seam")
    found = states(slide(tracker, other, 0, len(other.strain) - 1))
    assert found[:2] == [State.SEARCHING, State.UNKNOWN]
    assert State.CONVERGED not in found


def test_a_hand_that_is_lifted_and_put_elsewhere_is_lost_until_it_converges_again(tracker):
    sweep = kidnapped_sweep()
    estimates = slide(tracker, sweep, 0, len(sweep.strain) - 1)
    found = states(estimates)
    assert found[:3] == [State.SEARCHING, State.CONVERGED, State.LOST]
    assert found[-1] == State.CONVERGED
    assert np.linalg.norm(estimates[-1].mean - sweep.truth[-2]) < 0.003


def test_strains_and_positions_in_other_units_are_reported(tracker, sweep):
    slide(tracker, sweep, 0, 100)
    assert tracker.fit.trouble == ""
    tracker.reset()
    volts = dataclasses.replace(sweep, strain=1e3 * sweep.strain, stamp_ns=sweep.stamp_ns + 10**12)
    slide(tracker, volts, 0, 100)
    assert tracker.fit.shares[0] > 0.9
    assert "of the strains are outside the range of the scan" in tracker.fit.trouble
    tracker.reset()
    metres = dataclasses.replace(sweep, odometry=1e3 * sweep.odometry, stamp_ns=sweep.stamp_ns + 2 * 10**12)
    slide(tracker, metres, 0, 100)
    assert tracker.fit.shares[0] == 0.0
    assert "farther from the start than the scene is long" in tracker.fit.trouble


def test_a_few_strains_are_no_reason_to_report_a_misfit(tracker, sweep):
    slide(tracker, dataclasses.replace(sweep, strain=1e3 * sweep.strain), 0, 15)
    assert tracker.fit.trouble == ""
