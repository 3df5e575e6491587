"""Parts of the forward filter against analytic answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tactile_localizer.core.decision.convergence import Convergence, ConvergenceCriteria, State
from tactile_localizer.core.decision.presence import Presence
from tactile_localizer.core.filters.components import switched
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.likelihood.slow_residual import SlowResidual
from tactile_localizer.core.likelihood.student_t import scatter
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("line", (Axis("x", 0.0, 0.2, 0.05),), (Phalanx("index", (0.0,)),))


def test_innovations_give_the_density_of_the_whole_sequence() -> None:
    length, white, spacing = 0.004, 0.3, 0.001
    lag = np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
    covariance = (1.0 - white) * np.exp(-lag * spacing / length) + white * (lag == 0)
    values = np.random.default_rng(1).multivariate_normal(np.zeros(6), covariance)
    process, slow, total = SlowResidual(length, white), 0.0, 0.0
    for index, value in enumerate(values):
        step = process.step(spacing if index else 0.0)
        innovation = value - step.decay * slow
        slow = step.decay * slow + step.gain * innovation
        total -= 0.5 * (
            innovation**2 / step.innovation_variance + np.log(2 * np.pi * step.innovation_variance)
        )
    assert total == pytest.approx(multivariate_normal(np.zeros(6), covariance).logpdf(values))


def test_the_grid_is_a_kalman_filter_on_a_linear_gaussian_problem() -> None:
    grid = GridFilter(SCENE, np.array([0.0005]), np.zeros(1))
    mean, variance = 0.05, 0.004**2
    grid.seed(np.array([mean]), np.array([0.004]))
    rng = np.random.default_rng(2)
    for _ in range(15):
        grid.predict(np.array([0.0033]), 0.0033)
        mean, variance = mean + 0.0033, variance + 0.05**2 * 0.0033
        measured = mean + 0.003 * rng.standard_normal()
        prior = grid.prior()
        grid.update(-0.5 * ((prior.states - measured) / 0.006) ** 2, prior.memory)
        gain = variance / (variance + 0.006**2)
        mean, variance = mean + gain * (measured - mean), (1.0 - gain) * variance
    belief = grid.belief()
    assert belief.mean[0] == pytest.approx(mean, abs=1e-5)
    assert belief.covariance[0, 0] == pytest.approx(variance, rel=0.03)


def test_memory_rides_with_its_trajectory() -> None:
    grid = GridFilter(SCENE, np.array([0.001]), np.zeros(1), channels=1)
    prior = grid.prior()
    grid.update(np.zeros((len(prior.states), 1)), prior.states[:, None, :].astype(np.float32))
    grid.predict(np.array([0.0137]), 0.0)
    prior = grid.prior()
    np.testing.assert_allclose(prior.memory[:, 0, 0], prior.states[:, 0] - 0.0137, atol=1e-6)


def test_what_rides_off_the_scene_is_reported() -> None:
    grid = GridFilter(SCENE, np.array([0.001]), np.zeros(1))
    assert grid.predict(np.array([0.05]), 0.0) == pytest.approx(0.25)


def test_switching_keeps_the_mass_of_a_hypothesis() -> None:
    rng = np.random.default_rng(3)
    weights = np.log(rng.dirichlet(np.ones(12)).reshape(4, 3))
    prior = np.log(rng.dirichlet(np.ones(3), 4))
    after = switched(weights, prior, 0.2)
    np.testing.assert_allclose(np.exp(after).sum(axis=1), np.exp(weights).sum(axis=1))
    np.testing.assert_allclose(
        switched(weights, prior, 1.0) - np.logaddexp.reduce(weights, axis=1)[:, None], prior
    )


def test_the_scatter_is_robust_to_outliers() -> None:
    rng = np.random.default_rng(4)
    clean = rng.standard_normal((2000, 3))
    spoiled = np.concatenate([clean, 100.0 * rng.standard_normal((40, 3))])
    np.testing.assert_allclose(scatter(spoiled), np.eye(3), atol=0.25)


def test_presence_falls_off_the_map_and_returns() -> None:
    presence = Presence()
    presence.update(20.0)
    assert presence.probability > 0.99
    assert presence.predict(0.001, 0.0) < 1e-6
    presence.predict(0.001, 1.0)
    assert presence.probability < 0.01
    assert presence.predict(0.01, 0.0) > 0.9


def test_convergence_is_held_over_a_distance_and_released_below_one_half() -> None:
    convergence = Convergence(ConvergenceCriteria(np.array([0.005]), sustain=0.002))
    convergence.update(1.0, 0.999, 0.001)
    assert convergence.state is State.SEARCHING
    convergence.update(1.0, 0.999, 0.001)
    assert convergence.state is State.CONVERGED
    convergence.update(0.9, 0.9, 0.001)
    assert convergence.state is State.CONVERGED
    convergence.update(0.4, 0.9, 0.001)
    assert convergence.state is State.LOST
