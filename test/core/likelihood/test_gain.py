"""Gain of a sweep along its trajectories, against the textbook filter."""

import math

import numpy as np
import pytest
from support.models import KalmanFilter, LinearModel

from tactile_localizer.core.likelihood.gain import Gain

SIGNAL, PRIOR, VARIANCE = np.array([3.0, -1.0, 0.5]), 0.1, 2.0
INFORMATION = float(SIGNAL @ SIGNAL) / VARIANCE


def after(strains: np.ndarray, exponent: float = 1.0) -> Gain:
    """The gain after strains (n, C) at one place, of one phalanx along one trajectory."""
    gain = Gain.start(1, 1, PRIOR)
    for strain in strains:
        residual = strain - gain.mean[0, 0] * SIGNAL
        product = np.array([[SIGNAL @ residual / VARIANCE]])
        gain = gain.updated(np.full((1, 1), INFORMATION), product, exponent)
    return gain


def test_strains_are_taken_in_as_by_a_kalman_filter() -> None:
    strains = 0.7 * SIGNAL + np.random.default_rng(0).standard_normal((50, 3))
    kalman = KalmanFilter(np.ones(1), PRIOR * np.eye(1), LinearModel(SIGNAL[:, None], math.sqrt(VARIANCE)))
    for count, strain in enumerate(strains, 1):
        kalman.update(strain)
        found = after(strains[:count])
        assert found.mean[0, 0] == pytest.approx(kalman.mean[0], rel=1e-5)
        assert found.variance[0, 0] == pytest.approx(kalman.covariance[0, 0], rel=1e-5)


@pytest.mark.parametrize("exponent", [1.0, 0.25])
def test_strains_of_another_force_have_its_gain(exponent: float) -> None:
    """Precisions add up, of which a part of a measurement has its part."""
    for count in (1, 10, 1000):
        found, known = after(np.tile(1.5 * SIGNAL, (count, 1)), exponent), exponent * count * INFORMATION
        assert found.variance[0, 0] == pytest.approx(1.0 / (1.0 / PRIOR + known), rel=1e-4)
        assert found.mean[0, 0] == pytest.approx(1.0 + 0.5 * known / (1.0 / PRIOR + known), rel=1e-4)


def test_along_a_featureless_way_the_gain_of_before_is_forgotten() -> None:
    """As a Gauss-Markov process: in as many steps as may be."""
    before = after(np.tile(1.5 * SIGNAL, (10, 1)))
    nothing = np.zeros((1, 1))
    np.testing.assert_array_equal(before.updated(nothing, nothing, 1.0).moments, before.moments)
    whole, parts = before.predicted(0.01, PRIOR), before
    for _ in range(10):
        parts = parts.predicted(0.001, PRIOR)
    np.testing.assert_allclose(parts.moments, whole.moments, rtol=1e-5)
    kept = (whole.mean - 1.0) / (before.mean - 1.0)
    assert 0.0 < kept[0, 0] < 1.0
    np.testing.assert_allclose(whole.variance, PRIOR + kept**2 * (before.variance - PRIOR), rtol=1e-5)
    begun = Gain.start(1, 1, PRIOR).moments
    np.testing.assert_allclose(before.predicted(10.0, PRIOR).moments, begun, rtol=1e-6)
