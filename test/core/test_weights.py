"""Log-weights, effective sample size and moments."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.weights import effective_sample_size, moments, normalize

LOG_WEIGHTS = arrays(
    np.float64, st.integers(1, 60), elements=st.floats(-1e15, 1e15) | st.just(-math.inf), fill=st.nothing()
)


@given(log_weights=LOG_WEIGHTS)
@example(log_weights=np.full(4, -math.inf))
def test_normalized_weights_sum_to_one(log_weights):
    normalized, log_total = normalize(log_weights)
    assert np.exp(normalized).sum() == pytest.approx(1.0, abs=1e-13)
    if log_total == -math.inf:
        assert (normalized == normalized[0]).all(), "weights of zero become equal"
        return
    assert (normalized[log_weights == -math.inf] == -math.inf).all()
    clear = normalized > -30
    np.testing.assert_allclose(normalized[clear] + log_total, log_weights[clear], rtol=1e-15, atol=1e-12)


def test_the_total_is_that_of_the_weights():
    assert normalize(np.log([1.0, 2.0, 6.0]))[1] == pytest.approx(math.log(9.0))


def test_effective_sample_size_of_equal_weights():
    with np.errstate(divide="ignore"):
        assert effective_sample_size(np.log([0.25, 0.25, 0.25, 0.25, 0.0])) == pytest.approx(4.0)


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
