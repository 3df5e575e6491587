"""Blocks of cells: a wide belief is evaluated at fewer places, a peak at every cell."""

import numpy as np
import pytest
from support.scans import scene

from tactile_localizer.core.filters.blocks import MOST_APART, Blocks
from tactile_localizer.core.filters.grid import GridFilter

OF = scene()
EXTENT = OF.upper - OF.lower
CELL = EXTENT / [61, 60]
TRUTH = OF.lower + 0.4 * EXTENT


def log_likelihood(states: np.ndarray, std: float) -> np.ndarray:
    return -0.5 * np.square((states - TRUTH) / (std * EXTENT)).sum(axis=1)


def updated(coarse: np.ndarray | None, std: float, times: int = 1) -> tuple[GridFilter, int]:
    """A filter after some updates, and how many states it was evaluated at in the last."""
    grid = GridFilter(OF, CELL, coarse)
    for _ in range(times):
        states, _ = grid.prior()
        grid.update(log_likelihood(states, std))
    return grid, len(states)


def test_a_wide_belief_is_evaluated_at_a_quarter_of_the_places() -> None:
    grid, places = updated(2.0 * CELL, std=0.15)
    exact, everywhere = updated(None, std=0.15)
    assert everywhere == 61 * 60
    assert places == 31 * 30
    np.testing.assert_allclose(grid.belief().mean, exact.belief().mean, atol=0.05 * CELL.min())
    np.testing.assert_allclose(grid.belief().covariance, exact.belief().covariance, rtol=0.02, atol=1e-9)


def test_a_peak_is_evaluated_cell_by_cell() -> None:
    grid, places = updated(2.0 * CELL, std=0.04, times=4)
    exact, _ = updated(None, std=0.04, times=4)
    assert places < MOST_APART
    np.testing.assert_allclose(grid.belief().mean, exact.belief().mean, atol=0.05 * CELL.min())
    np.testing.assert_allclose(grid.belief().covariance, exact.belief().covariance, rtol=0.05, atol=1e-9)


def test_what_is_injected_is_evaluated_in_blocks_beside_a_peak() -> None:
    grid, _ = updated(2.0 * CELL, std=0.02, times=4)
    grid.inject(5e-3)
    states, log_prior = grid.prior()
    exact, _ = updated(None, std=0.02, times=4)
    apart = np.count_nonzero(exact.hypotheses()[1] > 1e-4 * exact.hypotheses()[1].max())
    assert apart < len(states) < apart + 31 * 30 + 5
    assert np.exp(log_prior).sum() == pytest.approx(1.0)
    # A likelihood far from the peak is found again.
    far = OF.lower + 0.9 * EXTENT
    for _ in range(3):
        states, _ = grid.prior()
        grid.update(-0.5 * np.square((states - far) / (0.02 * EXTENT)).sum(axis=1))
    np.testing.assert_allclose(grid.belief().mean, far, atol=CELL.max())


def test_an_equal_likelihood_changes_nothing() -> None:
    weights = np.random.default_rng(0).random(61 * 60)
    blocks = Blocks([np.arange(61.0), np.arange(60.0)], np.array([2, 2]))
    apart = blocks.divide(weights)
    assert len(apart) == 0
    np.testing.assert_allclose(blocks.spread(blocks.masses), weights)
    assert blocks.masses.sum() == pytest.approx(weights.sum())


def test_centres_lie_amid_the_cells_of_a_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactile_localizer.core.filters.blocks.MOST_APART", 0)
    blocks = Blocks([np.arange(5.0), np.arange(4.0)], np.array([2, 3]))
    blocks.divide(np.ones(20))
    np.testing.assert_array_equal(blocks.centres.T, [[x, y] for x in (0.5, 2.5, 4.0) for y in (1.0, 3.0)])
    np.testing.assert_array_equal(blocks.masses, [6, 2, 6, 2, 3, 1])
