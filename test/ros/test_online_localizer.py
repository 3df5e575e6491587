"""Strains and poses in any order give estimates in the order of the stamps."""

import dataclasses

import numpy as np
import pytest
from support.sweeps import unseen_sweep

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.ros.online_localizer import OnlineLocalizer
from tactile_localizer.sim import shipped_scene, simulate_scan
from tactile_localizer.streams.session import Session

MS = 1_000_000
OK = np.zeros(2, dtype=np.uint8)


@pytest.fixture(scope="module")
def scan():
    return simulate_scan("bump", seed=1)


@pytest.fixture(scope="module")
def localizer(scan):
    configuration = Configuration(cell=1.0)
    calibration = Calibration(np.array([0.0004, 0.0004]), Material.SHEET)
    scene, rng = shipped_scene("bump"), np.random.default_rng(0)
    return build_localizer(scan, scene, configuration, rng, None, calibration)


@pytest.fixture(scope="module")
def known(scan):
    return ScanRange.of(scan, shipped_scene("bump"))


class Stream(OnlineLocalizer):
    """An online localizer with the pairing of its inputs."""

    def __init__(self, localizer, known):
        super().__init__(localizer, 0.1, known)
        self.session = Session(localizer.scene.axes, max_gap_s=0.1, patience_s=1.0)

    def add_strain(self, stamp_ns, strain, status):
        self.session.add_strain(stamp_ns, (strain, status))
        return self.take(self.session.take())

    def add_pose(self, stamp_ns, position):
        self.session.add_pose(stamp_ns, position)
        return self.take(self.session.take())


@pytest.fixture
def online(localizer, known):
    return Stream(localizer, known)


@pytest.fixture(scope="module")
def sweep():
    return unseen_sweep()


def add_strain(online, sweep, k, status=OK):
    return online.add_strain(int(sweep.stamp_ns[k]) + 20 * MS, sweep.strain[k], status)


def add_pose(online, sweep, k):
    return online.add_pose(int(sweep.stamp_ns[k]), sweep.position[k])


def slide(online, sweep, first, last):
    estimates = []
    for k in range(first, last):
        estimates += add_pose(online, sweep, k) + add_strain(online, sweep, k)
    return estimates + add_pose(online, sweep, last)


def test_strain_in_a_pose_gap_gives_no_estimate(online, sweep):
    slide(online, sweep, 0, 10)
    for k in range(10, 20):
        add_strain(online, sweep, k)
    assert [e.stamp_ns for e in add_pose(online, sweep, 20)] == []
    assert online.counts["without a pose"] == 10
    assert "no palm pose" in online.last_error
    assert slide(online, sweep, 20, 22)
    assert online.last_error == ""


def test_no_travel_is_the_reason_for_no_convergence(online, sweep):
    slide(online, sweep, 0, 1)
    assert online.latest.reason == "not converged: 0.0 mm travelled"
    slide(online, sweep, 1, 40)
    assert online.latest.travel > 0.001
    assert "travelled" not in online.latest.reason


def test_a_faulty_phalanx_is_ignored(online, sweep):
    for k, status in enumerate(([0, 0], [1, 0], [0, 2], [0, 4], [0, 0])):
        strain = np.where(np.repeat(status, 8), np.nan, sweep.strain[k])
        add_pose(online, sweep, k)
        online.add_strain(int(sweep.stamp_ns[k]) + 20 * MS, strain, np.array(status, dtype=np.uint8))
    assert add_pose(online, sweep, 5)
    assert (online.counts["without index"], online.counts["without middle"]) == (1, 2)
    assert online.estimates == 5


def test_without_usable_phalanges_there_is_no_estimate(online, sweep):
    slide(online, sweep, 0, 5)
    before = online.latest
    add_strain(online, sweep, 5, status=np.array([1, 4], dtype=np.uint8))
    assert add_pose(online, sweep, 6) == []
    assert online.latest is before
    assert online.counts["without a phalanx with status OK"] == 1
    assert "no phalanx" in online.last_error


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nonfinite_strain_keeps_the_belief(online, sweep, bad):
    slide(online, sweep, 0, 5)
    before = online.latest
    sweep = dataclasses.replace(sweep, strain=sweep.strain.copy())
    sweep.strain[5, 3] = bad
    add_strain(online, sweep, 5)
    assert add_pose(online, sweep, 6) == []
    assert online.counts["that are not finite"] == 1
    assert "finite" in online.last_error
    assert online.latest is before


def test_a_forward_jump_keeps_the_belief(online, sweep):
    slide(online, sweep, 0, 50)
    assert online.session.forward_jumps == 0
    later = dataclasses.replace(sweep, stamp_ns=sweep.stamp_ns + 10_000_000_000)
    travel = online.latest.travel
    slide(online, later, 50, 60)
    assert online.session.forward_jumps == 1
    assert online.latest.travel > travel


@pytest.mark.parametrize("begin", ["reset", "seed"])
def test_strain_stamped_before_a_reset_is_ignored(online, sweep, begin):
    slide(online, sweep, 0, 60)
    for k in range(61, 101):
        add_pose(online, sweep, k)
    since_ns = int(sweep.stamp_ns[99]) + 20 * MS  # of the last strain that is ignored
    if begin == "reset":
        online.reset(since_ns)
    else:
        online.seed(np.array([0.01, 0.03]), np.array([0.001, 0.001]), since_ns)
    assert [e for k in range(60, 100) for e in add_strain(online, sweep, k)] == []
    assert online.counts["earlier"] == 40
    (first, *_) = slide(online, sweep, 100, 103)
    assert first.travel == 0.0
    assert slide(online, sweep, 0, 5), "after a backward jump nothing is earlier"


def test_inputs_in_other_units_are_reported(online, sweep):
    slide(online, sweep, 0, 100)
    assert online.out_of_range == (0.0, 0.0)
    online.reset()
    volts = dataclasses.replace(sweep, strain=1e3 * sweep.strain, stamp_ns=sweep.stamp_ns + 10**12)
    slide(online, volts, 0, 100)
    assert online.out_of_range[0] > 0.9
    online.reset()
    assert online.out_of_range == (0.0, 0.0)
    metres = dataclasses.replace(sweep, position=1e3 * sweep.position, stamp_ns=sweep.stamp_ns + 2 * 10**12)
    slide(online, metres, 0, 100)
    assert online.out_of_range == (0.0, 1.0)
