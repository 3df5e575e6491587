"""The multivariate normal density, fitted to samples."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_triangular

RIDGE = 1e-3
"""Share of a channel's variance that is added to the diagonal, so that no direction is taken as certain."""


class Normal:
    """N(mean, covariance) over D channels.

    Parameters
    ----------
    mean : (D,)
    covariance : (D, D), positive definite
    """

    def __init__(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        self.mean = mean
        self.covariance = covariance
        factor = np.linalg.cholesky(covariance)
        self._whiten = solve_triangular(factor, np.eye(len(mean)), lower=True).T
        self._log_constant = -0.5 * len(mean) * math.log(2 * math.pi) - float(np.log(np.diag(factor)).sum())

    @classmethod
    def fitted(cls, samples: np.ndarray) -> Normal:
        """From the sample moments of (N, D), with :data:`RIDGE` of each variance on the diagonal."""
        covariance = np.atleast_2d(np.cov(samples.T, bias=True))
        return cls(samples.mean(axis=0), covariance + ridge(covariance, samples))

    def log_density(self, value: np.ndarray) -> np.ndarray:
        """Log-density of values (..., D): (...)."""
        return self._log_constant - 0.5 * self.squared_distance(value)

    def squared_distance(self, value: np.ndarray) -> np.ndarray:
        """Squared Mahalanobis distance of values (..., D) from the mean: (...)."""
        white = (value - self.mean) @ self._whiten
        return np.asarray(np.einsum("...d,...d->...", white, white))


def ridge(covariance: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """A diagonal (D, D) that keeps ``covariance`` positive definite, even where a channel never varied."""
    size = np.abs(samples).max(axis=0)
    return np.diag(RIDGE * np.diag(covariance) + (1e-6 * size) ** 2 + 1e-24)
