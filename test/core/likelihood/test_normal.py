"""A normal density fitted to samples is a density, even of samples that do not span the space."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactile_localizer.core.likelihood.kernels.normal import Normal


def test_its_logarithm_is_that_of_the_textbook():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((8, 8))
    covariance, mean = root @ root.T + np.eye(8), rng.standard_normal(8)
    points = rng.standard_normal((3, 5, 8))
    expected = stats.multivariate_normal(mean, covariance).logpdf(points)
    np.testing.assert_allclose(Normal(mean, covariance).log_density(points), expected)


def test_fitted_to_many_samples_it_is_their_distribution():
    rng = np.random.default_rng(0)
    samples = rng.standard_normal((100_000, 3)) @ np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 2.0]]) + [1, 2, 3]
    fitted = Normal.fitted(samples)
    np.testing.assert_allclose(fitted.mean, [1, 2, 3], atol=0.03)
    np.testing.assert_allclose(fitted.covariance, np.cov(samples.T), rtol=0.01, atol=0.01)


@given(
    count=st.integers(1, 20),
    scale=st.sampled_from([0.0, 1e-9, 1e-3, 1.0, 1e9]),
    away=st.sampled_from([0.0, 1.0, 1e9]),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_samples_give_a_finite_density_highest_at_their_mean(count, scale, away, seed):
    samples = away + scale * np.random.default_rng(seed).standard_normal((count, 8))
    fitted = Normal.fitted(samples)
    at_mean, beside = fitted.log_density(np.stack([fitted.mean, samples[0] + 1e-3 * (scale + away) + 1e-9]))
    assert np.isfinite(at_mean)
    assert np.isfinite(beside)
    assert at_mean >= beside
