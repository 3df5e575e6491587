"""A normal density fitted to samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactile_localizer.core.likelihood.kernels.normal import RIDGE, Normal


def test_it_has_the_moments_of_the_samples_and_the_noise():
    rng = np.random.default_rng(0)
    samples = rng.standard_normal((500, 8)) @ rng.standard_normal((8, 8)) + np.arange(8)
    covariance = np.cov(samples.T, bias=True)
    covariance += np.diag(RIDGE * covariance.diagonal() + 0.3**2)
    expected = stats.multivariate_normal(samples.mean(axis=0), covariance)
    for point in rng.standard_normal((5, 8)):
        assert Normal(samples, np.full(8, 0.3)).log_density(point) == pytest.approx(expected.logpdf(point))


@given(
    count=st.integers(1, 20),
    scale=st.sampled_from([0.0, 1e-9, 1e-3, 1.0, 1e9]),
    away=st.sampled_from([0.0, 1.0, 1e9]),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_samples_give_a_finite_density_highest_at_their_mean(count, scale, away, seed):
    samples = away + scale * np.random.default_rng(seed).standard_normal((count, 8))
    fitted = Normal(samples, np.zeros(8))
    at_mean = fitted.log_density(samples.mean(axis=0))
    beside = fitted.log_density(samples[0] + 1e-3 * (scale + away) + 1e-9)
    assert np.isfinite([at_mean, beside]).all()
    assert at_mean >= beside
