"""Student-t densities and robust scatter."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln

from tactile_localizer.core.likelihood.student_t import (
    DEGREES_OF_FREEDOM,
    log_density,
    scatter,
)

NU = DEGREES_OF_FREEDOM


def log_constant(channels: int) -> float:
    """Constant omitted by :func:`log_density`."""
    return float(gammaln((NU + channels) / 2) - gammaln(NU / 2) - channels / 2 * np.log(NU * np.pi))


@pytest.mark.parametrize("channels", [1, 8, 19])
def test_the_density_is_the_multivariate_t(channels: int) -> None:
    rng = np.random.default_rng(0)
    residual, variance = 3.0 * rng.standard_normal((20, channels)), rng.uniform(0.1, 10.0, 20)
    expected = [
        stats.multivariate_t(np.zeros(channels), v * np.eye(channels), df=NU).logpdf(r)
        for r, v in zip(residual, variance, strict=True)
    ]
    found = log_density(np.sum(residual**2, axis=1), variance, channels) + log_constant(channels)
    np.testing.assert_allclose(found, expected)


def test_the_scatter_recovers_that_of_a_t_distribution() -> None:
    shape = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 0.5]])
    samples = stats.multivariate_t(np.zeros(3), shape, df=NU, seed=1).rvs(20_000)
    np.testing.assert_allclose(scatter(samples), shape, rtol=0.05, atol=0.02)


def test_the_scatter_is_robust_to_outliers() -> None:
    rng = np.random.default_rng(4)
    clean = rng.standard_normal((2000, 3))
    spoiled = np.concatenate([clean, 100.0 * rng.standard_normal((40, 3))])
    np.testing.assert_allclose(scatter(spoiled), scatter(clean), atol=0.15)


@pytest.mark.parametrize("samples", [np.zeros((30, 4)), np.zeros((1, 4)), np.ones((2, 4))])
def test_the_scatter_of_constant_or_few_samples_is_finite(samples: np.ndarray) -> None:
    assert np.isfinite(scatter(samples)).all()
