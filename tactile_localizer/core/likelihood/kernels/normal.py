"""Multivariate normal density, fitted to samples."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_triangular

RIDGE = 1e-3
"""Fraction of a channel's variance that is added to the diagonal, so that no direction has zero variance."""


class Normal:
    """Normal distribution with the moments of samples, convolved with independent noise.

    Parameters
    ----------
    samples : (N, D)
    noise_std : (D,) standard deviations of the noise
    """

    def __init__(self, samples: np.ndarray, noise_std: np.ndarray) -> None:
        covariance = np.atleast_2d(np.cov(samples.T, bias=True))
        covariance += ridge(covariance, samples) + np.diag(noise_std**2)
        factor = np.linalg.cholesky(covariance)
        self._mean = samples.mean(axis=0)
        self._whitening = solve_triangular(factor, np.eye(len(factor)), lower=True).T
        self._log_constant = -0.5 * len(factor) * math.log(2 * math.pi) - np.log(np.diag(factor)).sum()

    def log_density(self, value: np.ndarray) -> float:
        """Log-density of a value (D,)."""
        white = (value - self._mean) @ self._whitening
        return float(self._log_constant - 0.5 * (white @ white))


def ridge(covariance: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Diagonal (D, D) that makes ``covariance`` positive definite, even for a channel that never varies."""
    size = np.abs(samples).max(axis=0)
    return np.diag(RIDGE * np.diag(covariance) + (1e-6 * size) ** 2 + 1e-24)
