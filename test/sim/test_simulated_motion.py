"""Motion of the arm and of the material."""

import numpy as np
import pytest

from tactile_localizer.sim.motion import FIXTURED, HANGING, sweep_motion

START, END, SPEED, RATE = (0.0, 0.010), (0.0508, 0.010), 6.8e-3, 100.0


def motions(looseness, count=150):
    return [
        sweep_motion(np.random.default_rng(seed), START, END, SPEED, RATE, looseness) for seed in range(count)
    ]


def errors(looseness, share):
    """Odometry's error of displacement after a share of the sweep, (sweeps, 2) m."""
    drifted = []
    for motion in motions(looseness):
        error = motion.odometry - motion.truth
        drifted.append(error[int(share * (len(error) - 1))] - error[0])
    return np.array(drifted)


def test_a_sweep_goes_from_its_start_to_its_end():
    for motion in motions(HANGING, 20):
        np.testing.assert_allclose(motion.odometry[0], START, atol=1e-3)
        np.testing.assert_allclose(motion.odometry[-1], END, atol=1e-3)
        assert np.all(np.diff(motion.odometry[::20, 0]) > 0)


def test_speed_varies_within_a_sweep_and_between_sweeps():
    speeds = [np.diff(motion.odometry[50:-50:10, 0]) * RATE / 10 for motion in motions(FIXTURED, 40)]
    assert np.mean([np.mean(speed) for speed in speeds]) == pytest.approx(SPEED, rel=0.03)
    assert 0.02 < np.std([np.mean(speed) for speed in speeds]) / SPEED < 0.1
    assert 0.03 < np.mean([np.std(speed) for speed in speeds]) / SPEED < 0.2


def test_hanging_material_slips_by_almost_a_millimetre():
    along, across = np.std(errors(HANGING, 1.0), axis=0)
    assert 0.6e-3 < along < 1.1e-3
    assert 0.15e-3 < across < 0.45e-3


def test_odometry_error_is_a_random_walk():
    quarter, whole = (np.var(errors(HANGING, share)[:, 0]) for share in (0.25, 1.0))
    assert 1.8 < whole / quarter < 5


def test_fixtured_material_slips_less():
    along = np.std(errors(FIXTURED, 1.0)[:, 0])
    assert 0.2e-3 < along < 0.5e-3


def test_friction_rises_while_sticking():
    tension = np.concatenate([motion.tension for motion in motions(HANGING, 20)])
    steps = np.diff(tension)
    assert np.mean(steps > 0) > 0.6
    assert abs(np.min(steps)) > 2 * np.max(steps[np.abs(steps) < 0.01])


def test_the_fingers_slide_along_the_sweep():
    for motion in motions(HANGING, 10):
        np.testing.assert_allclose(np.linalg.norm(motion.direction, axis=1), 1)
        assert np.all(motion.direction[:, 0] > 0.98)
