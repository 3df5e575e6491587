"""Robust scatter of Student-t samples."""

import numpy as np
from scipy import stats

from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, scatter


def test_the_scatter_recovers_that_of_a_t_distribution() -> None:
    shape = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 0.5]])
    samples = stats.multivariate_t(np.zeros(3), shape, df=DEGREES_OF_FREEDOM, seed=1).rvs(20_000)
    np.testing.assert_allclose(scatter(samples), shape, rtol=0.05, atol=0.02)
