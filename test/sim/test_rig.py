"""The simulated hand as a function of time."""

import numpy as np
import pytest

from tactile_localizer.sim import simulate_sweep
from tactile_localizer.sim.rig import Phase, Rig
from tactile_localizer.sim.scan import sweep_plan
from tactile_localizer.sim.sweep import CELLS

UNLOADED = np.concatenate([cell.bias for cell in CELLS])
SPEED, RATE = 6.8e-3, 50.0


@pytest.fixture
def rig():
    return Rig("bump", 1, SPEED, RATE)


def test_the_hand_starts_with_open_fingers(rig):
    moment = rig.read(12.0)
    assert moment.phase is Phase.OPEN
    assert moment.truth is None
    np.testing.assert_allclose(moment.strain, UNLOADED, atol=0.02)


def test_prepare_moves_then_closes_the_fingers(rig):
    sweep = rig.prepare("train", 10.0)
    assert rig.read(10.2).phase is Phase.OPEN
    np.testing.assert_allclose(rig.read(10.2).strain, UNLOADED, atol=0.02)
    closed = rig.read(rig.ready_s)
    assert closed.phase is Phase.READY
    np.testing.assert_allclose(closed.strain, sweep.strain[0], atol=0.02)
    np.testing.assert_array_equal(closed.truth, sweep.truth[0])
    assert rig.read(rig.ready_s + 100).phase is Phase.READY


def test_a_sweep_follows_the_simulation(rig):
    sweep = rig.prepare("train", 0.0)
    start, end = sweep_plan("train", 0, 1)
    again = simulate_sweep("bump", 1, 0, "train", start=start, end=end, speed=SPEED, rate=RATE)
    np.testing.assert_array_equal(sweep.strain, again.strain)
    rig.start(5.0)
    for index in (1, 100, len(sweep.strain) - 2):
        moment = rig.read(5.0 + index / RATE)
        assert moment.phase is Phase.SWEEPING
        np.testing.assert_array_equal(moment.strain, sweep.strain[index])
        np.testing.assert_allclose(moment.odometry, sweep.position[index], atol=1e-9)
        np.testing.assert_allclose(moment.truth, sweep.truth[index], atol=1e-9)
    between = rig.read(5.0 + 100.25 / RATE).odometry
    np.testing.assert_allclose(between, 0.75 * sweep.position[100] + 0.25 * sweep.position[101])
    after = rig.read(5.0 + len(sweep.stamp_ns) / RATE + 3)
    assert after.phase is Phase.DONE
    np.testing.assert_array_equal(after.odometry, sweep.position[-1])
    np.testing.assert_allclose(after.strain, sweep.strain[-1], atol=0.02)


def test_the_palm_moves_continuously(rig):
    sweep = rig.prepare("train", 0.0)
    rig.start(1.0)
    end_s = 1.0 + len(sweep.stamp_ns) / RATE + 1
    rig.read(end_s)
    rig.prepare("test", end_s)
    path = np.array([rig.read(t).odometry for t in np.arange(end_s - 0.1, rig.ready_s + 0.1, 1e-3)])
    way = np.linalg.norm(path[-1] - path[0])
    assert np.max(np.linalg.norm(np.diff(path, axis=0), axis=1)) < 0.01 * way


def test_an_early_start_waits_for_the_fingers(rig):
    rig.prepare("train", 0.0)
    rig.start(0.0)
    assert rig.read(rig.ready_s - 1e-6).phase is not Phase.SWEEPING
    assert rig.read(rig.ready_s + 0.1).phase is Phase.SWEEPING


def test_training_and_test_sweeps_are_counted_separately(rig):
    numbers = [
        rig.prepare(kind, 100.0 * i).number for i, kind in enumerate(("train", "test", "train", "test"))
    ]
    assert numbers == [0, 0, 1, 1]
