"""What trajectories carry stays with them, however the filter moves, resamples or replaces them."""

import numpy as np
import pytest

from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.scene import Axis, Phalanx, Scene

LINE = Scene("line", (Axis("x", 0.0, 0.1, 0.0),), (Phalanx("a", (0.0,)),))


@pytest.fixture(params=["grid", "particle"])
def carrying(request: pytest.FixtureRequest) -> BayesFilter:
    """A filter whose states carry where their trajectories began."""
    made: BayesFilter = (
        GridFilter(LINE, np.array([0.001]))
        if request.param == "grid"
        else ParticleFilter(LINE, np.random.default_rng(0), 400)
    )
    made.carry(1)
    states, _ = made.prior()
    made.store(states.copy())
    return made


def test_a_trajectory_carries_its_numbers_along(carrying: BayesFilter) -> None:
    carrying.predict(np.array([0.02]), 0.02)
    states, log_prior = carrying.prior()
    moved = (states - carrying.carried())[log_prior > -np.inf]
    np.testing.assert_allclose(moved, 0.02, atol=1e-9)


def test_resampled_trajectories_carry_what_their_ancestors_did(carrying: BayesFilter) -> None:
    states, _ = carrying.prior()
    carrying.update(-0.5 * ((states[:, 0] - 0.05) / 0.005) ** 2)
    carrying.predict(np.array([0.01]), 0.01)
    states, log_prior = carrying.prior()
    moved = (states - carrying.carried())[log_prior > -20.0]
    np.testing.assert_allclose(moved, 0.01, atol=0.003)  # particles are jittered


def test_trajectories_that_begin_anew_carry_nothing(carrying: BayesFilter) -> None:
    carrying.reset()
    carrying.prior()
    assert not carrying.carried().any()


def test_an_injected_belief_carries_nothing(carrying: BayesFilter) -> None:
    carrying.prior()
    before = carrying.carried().sum()
    carrying.inject(0.5)
    carrying.prior()
    assert carrying.carried().sum() == pytest.approx(0.5 * before, rel=0.2)
