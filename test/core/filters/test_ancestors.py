"""A state knows its ancestor, however the filter moves, resamples or replaces the states."""

import numpy as np
import pytest

from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.scene import Axis, Phalanx, Scene

LINE = Scene("line", (Axis("x", 0.0, 0.1, 0.0),), (Phalanx("a", (0.0,)),))


@pytest.fixture(params=["grid", "particle"])
def either(request: pytest.FixtureRequest) -> BayesFilter:
    """One of the filters, after its first strain."""
    made: BayesFilter = (
        GridFilter(LINE, np.array([0.001]))
        if request.param == "grid"
        else ParticleFilter(LINE, np.random.default_rng(0), 400)
    )
    made.prior()
    return made


def travelled(one: BayesFilter, before: np.ndarray) -> np.ndarray:
    """How far the states that have an ancestor and weight are from it, m."""
    states, log_prior = one.prior()
    index, share = one.ancestors()
    return (states - before[index])[(share > 0.0) & (log_prior > -20.0)]


def test_a_state_comes_from_where_it_was(either: BayesFilter) -> None:
    before, _ = either.prior()
    either.predict(np.array([0.02]), 0.02)
    moved = travelled(either, before.copy())
    assert len(moved) >= 75
    np.testing.assert_allclose(moved, 0.02, atol=1e-9)


def test_resampled_states_come_from_what_they_copy(either: BayesFilter) -> None:
    before, _ = either.prior()
    before = before.copy()
    either.update(-0.5 * ((before[:, 0] - 0.05) / 0.005) ** 2)
    either.predict(np.array([0.01]), 0.01)
    np.testing.assert_allclose(travelled(either, before), 0.01, atol=0.008)  # particles are jittered


def test_after_a_reset_no_state_has_an_ancestor(either: BayesFilter) -> None:
    either.reset()
    either.prior()
    assert not either.ancestors()[1].any()


def test_an_injected_belief_has_no_ancestors(either: BayesFilter) -> None:
    either.inject(0.5)
    _, log_prior = either.prior()
    assert np.exp(log_prior) @ either.ancestors()[1] == pytest.approx(0.5, abs=0.1)
