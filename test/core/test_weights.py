"""Bayes' rule for weights, effective sample size and moments."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.weights import bayes, effective_sample_size, moments

LOG_LIKELIHOODS = arrays(
    np.float64, st.integers(1, 60), elements=st.floats(-1e15, 1e15) | st.just(-math.inf), fill=st.nothing()
)


@given(log_likelihood=LOG_LIKELIHOODS, seed=st.integers(0, 100))
@example(log_likelihood=np.full(4, -math.inf), seed=0)
@example(log_likelihood=np.array([0.0, -2000.0]), seed=1)
def test_bayes_rule(log_likelihood, seed):
    prior = np.random.default_rng(seed).random(len(log_likelihood))
    prior[0] *= 1e-300 ** (seed % 2)
    prior /= prior.sum()
    posterior, log_marginal = bayes(prior, log_likelihood)
    assert posterior.sum() == pytest.approx(1.0, abs=1e-13)
    if log_marginal == -math.inf:
        np.testing.assert_array_equal(posterior, prior, "what is impossible everywhere changes nothing")
        return
    assert not posterior[log_likelihood == -math.inf].any()
    clear = posterior > 1e-13
    expected = log_likelihood[clear] - np.log(posterior[clear] / prior[clear])
    np.testing.assert_allclose(expected, log_marginal, rtol=1e-15, atol=1e-12)


def test_what_has_no_weight_gets_none_however_likely():
    posterior, log_marginal = bayes(np.array([0.0, 0.25, 0.75]), np.array([1e6, 1.0, 1.0]))
    np.testing.assert_allclose(posterior, [0.0, 0.25, 0.75])
    assert log_marginal == pytest.approx(1.0)


def test_the_marginal_is_the_mean_likelihood():
    assert bayes(np.full(3, 1 / 3), np.log([1.0, 2.0, 6.0]))[1] == pytest.approx(math.log(3.0))


def test_effective_sample_size_of_equal_weights():
    assert effective_sample_size(np.array([0.25, 0.25, 0.25, 0.25, 0.0])) == pytest.approx(4.0)


def test_moments_are_the_weighted_mean_and_covariance():
    rng = np.random.default_rng(0)
    states, weights = rng.standard_normal((500, 3)), rng.random(500)
    weights /= weights.sum()
    mean, covariance = moments(states, weights, np.zeros(3, bool))
    np.testing.assert_allclose(mean, np.average(states, axis=0, weights=weights))
    np.testing.assert_allclose(covariance, np.cov(states.T, aweights=weights, ddof=0))


@given(centre=st.floats(-math.pi, math.pi), spread=st.floats(0.0, 0.3))
def test_the_mean_heading_is_the_circular_one(centre, spread):
    angles = wrap_angle(centre + spread * np.array([-1.0, 0.0, 1.0]))[:, None]
    mean, covariance = moments(angles, np.full(3, 1 / 3), np.ones(1, bool))
    assert abs(float(wrap_angle(mean[0] - centre))) < 1e-9
    assert covariance[0, 0] == pytest.approx(2 / 3 * spread**2, abs=1e-12)


@given(angle=st.floats(-1e6, 1e6))
def test_a_wrapped_angle_is_the_same_direction(angle):
    wrapped = float(wrap_angle(np.array(angle)))
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-8)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-8)
