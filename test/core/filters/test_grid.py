"""The grid filter is the exact Bayes recursion: prediction and measurement update keep the moments."""

import numpy as np
import pytest
from support.models import flat_update
from support.scans import scene

from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.errors import SceneError
from tactile_localizer.scene import Axis, Phalanx, Scene


def line(motion_std=0.0, half=0.5):
    return Scene("line", (Axis("x", -half, half, motion_std),), (Phalanx("a", (0.0,)), Phalanx("b", (0.0,))))


def test_cells_are_no_larger_than_asked_and_fill_the_scene():
    grid = GridFilter(scene(), np.array([0.0007, 0.2]))
    states, weights = grid.hypotheses()
    assert len(states) == len(weights) == 72
    assert states[:, 0].min() == pytest.approx(0.05 / 144)
    assert states[:, 1] == pytest.approx(0.025)


def test_the_mean_follows_motion_far_below_a_cell_without_drift_or_smear():
    """Twenty thousand steps of a thousandth of a cell, to and fro, keep the spread of the first moment."""
    grid = GridFilter(line(), np.array([0.01]))
    grid.seed(np.array([0.0]), np.array([0.05]))
    before = flat_update(grid)
    rng = np.random.default_rng(0)
    steps = 1e-5 * rng.standard_normal(20_000)
    steps += np.where(np.arange(20_000) % 4_000 < 2_000, 1e-5, -1e-5)
    for step in steps:
        grid.predict(np.array([step]), abs(step))
    after = flat_update(grid)
    assert after.mean[0] - before.mean[0] == pytest.approx(steps.sum(), abs=1e-9)
    assert after.covariance[0, 0] == pytest.approx(before.covariance[0, 0], rel=1e-9)


@pytest.mark.parametrize("step", [1e-4, 0.01, 0.04])
def test_the_variance_grows_with_the_travel_whatever_the_steps(step):
    """Small diffusion is saved up, large diffusion is one wide kernel: the sum is the same."""
    grid = GridFilter(line(motion_std=0.1), np.array([0.01]))
    grid.seed(np.array([0.0]), np.array([0.03]))
    before = flat_update(grid).covariance[0, 0]
    for turn in range(round(0.4 / step)):
        grid.predict(np.array([step if turn % 2 else -step]), step)
    assert flat_update(grid).covariance[0, 0] - before == pytest.approx(0.1**2 * 0.4, rel=2e-3)


def test_more_cells_than_memory_is_meant_for_are_refused():
    with pytest.raises(SceneError, match="expected at most 1,000,000 cells, got 2,500,000,000"):
        GridFilter(scene(), np.array([1e-6, 1e-6]))


@pytest.mark.parametrize("step", [1e-5, 1e-4, 1e-3])
def test_diffusion_that_is_saved_up_is_part_of_the_covariance(step):
    """Between two diffusions of the cells too, and a belief that begins anew has none left."""
    grid = GridFilter(line(motion_std=0.1), np.array([0.01]))
    for _ in range(2):
        grid.seed(np.array([0.0]), np.array([0.03]))
        before = flat_update(grid).covariance[0, 0]
        assert before == pytest.approx(0.03**2 + 0.01**2 / 12.0, abs=1e-8)
        grid.predict(np.zeros(1), step)
        assert flat_update(grid).covariance[0, 0] - before == pytest.approx(0.1**2 * step, rel=1e-3)


def test_what_diffuses_beyond_a_bound_has_left():
    """Of a belief 5 mm from a bound, with a step of 20 mm, two fifths."""
    grid = GridFilter(line(motion_std=0.1), np.array([0.01]))
    grid.seed(np.array([0.495]), np.array([0.005]))
    flat_update(grid)
    assert grid.predict(np.array([0.0]), 0.04).left == pytest.approx(0.4, abs=0.1)
