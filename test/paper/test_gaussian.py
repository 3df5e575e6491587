"""The single-Gaussian models, with moments of the nearest pairs and shrinkage."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.scans import scan, scene, strain_at

from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.errors import ParameterError
from tactile_localizer.paper.gaussian import Gaussian, IndependentGaussian

STATE = np.array([0.021, 0.033])


def nearest(of, made, state, k):
    """Rows of the k pairs nearest to a state, by travel."""
    apart = made.states - state
    apart[:, of.wraps] = np.angle(np.exp(1j * apart[:, of.wraps]))
    return np.argsort(np.linalg.norm(apart * [1.0, 1.0, YAW_LEVER][: of.dimension], axis=1))[:k]


@pytest.mark.parametrize(
    ("k", "of"),
    [(2, scene(2, 1)), *((k, scene(2, 2)) for k in (1, 2, 8, 30, 10**9)), (8, scene(3, 2, full_turn=True))],
)
def test_the_density_is_a_gaussian_of_the_nearest_pairs(k, of):
    made = scan(np.random.default_rng(1), of, 600, noise=0.05)
    model = Gaussian(made, of, k)
    for state in (np.array([*STATE, math.pi]), np.array([0.04, 0.01, 0.3 - math.pi])):
        own = made.strain[nearest(of, made, state[: of.dimension], k)]
        measured = own.mean(axis=0) + 0.3 * np.sqrt(np.diag(model._target))
        scatter, dimension = len(own) * np.cov(own.T, bias=True), own.shape[1]
        covariance = (scatter + (dimension + 1) * model._target) / (len(own) + dimension)
        expected = stats.multivariate_normal(own.mean(axis=0), covariance).logpdf(measured)
        (found,) = model.log_likelihood(state[None, : of.dimension], measured)
        assert found + math.log(1.01) == pytest.approx(expected, abs=0.02)  # the background's weight


@pytest.mark.parametrize("k", [1, 8, 20])
def test_independent_phalanges_multiply(k):
    of = scene()
    made = scan(np.random.default_rng(1), of, 300)
    model = IndependentGaussian(made, of, k)
    states = of.lower + np.random.default_rng(2).random((40, 2)) * 0.05
    measured = strain_at(STATE[None])[0]
    apart = [model.log_likelihood(states, measured, present) for present in np.eye(2, dtype=bool)]
    # The floor is mixed in once, not once a phalanx: compare where it does not matter.
    together = model.log_likelihood(states, measured)
    near = together > together.max() - 10
    np.testing.assert_allclose(together[near], sum(apart)[near], atol=0.05)


def test_fewer_than_one_neighbour_is_refused():
    with pytest.raises(ParameterError, match="neighbours: expected at least 1, got 0"):
        Gaussian(scan(np.random.default_rng(1), scene(), 200), scene(), 0)


@pytest.mark.parametrize(("constant", "unit"), [(1e6, 1.0), (0.0, 1e-9), (0.0, 1e-12), (1e6, 1e3)])
def test_neither_a_large_constant_nor_another_unit_changes_the_places(constant, unit):
    of = scene()
    made = scan(np.random.default_rng(1), of, 300)
    states = of.lower + np.random.default_rng(2).random((40, 2)) * 0.05
    measured = strain_at(STATE[None])[0]
    plain = Gaussian(made, of).log_likelihood(states, measured)
    moved = replace(made, strain=unit * (made.strain + constant))
    other = Gaussian(moved, of).log_likelihood(states, unit * (measured + constant))
    np.testing.assert_allclose(other - other.max(), plain - plain.max(), atol=0.01)
