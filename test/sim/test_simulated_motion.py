"""Motion of the arm and of the material."""

import numpy as np

from tactile_localizer.sim.motion import FIXTURED, HANGING, sweep_motion

START, END, SPEED, RATE = (0.0, 0.010), (0.0508, 0.010), 6.8e-3, 100.0


def motions(looseness, count=150):
    return [
        sweep_motion(np.random.default_rng(seed), START, END, SPEED, RATE, looseness) for seed in range(count)
    ]


def spread(looseness):
    """Standard deviation of the odometry's error of a whole sweep, along and across it, m."""
    errors = [motion.odometry - motion.truth for motion in motions(looseness)]
    return np.std([error[-1] - error[0] for error in errors], axis=0)


def test_hanging_material_slips_by_almost_a_millimetre_and_fixtured_less():
    along, across = spread(HANGING)
    assert 0.6e-3 < along < 1.1e-3
    assert 0.15e-3 < across < 0.45e-3
    assert 0.2e-3 < spread(FIXTURED)[0] < 0.5e-3
