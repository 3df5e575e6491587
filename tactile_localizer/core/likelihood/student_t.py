"""Multivariate Student-t distribution, of the difference between two visits to a place."""

from __future__ import annotations

import numpy as np

DEGREES_OF_FREEDOM = 8.0
"""Heavy enough that single outliers of several standard deviations hardly change the belief. By judgement."""

_ITERATIONS = 25


def log_density(squared: np.ndarray, variance: np.ndarray, channels: int | np.ndarray) -> np.ndarray:
    """Log-density up to a constant that depends on ``channels`` alone.

    Parameters
    ----------
    squared : (...) squared length of the whitened residual
    variance : (...) squared scale of the distribution, in units of the whitened variance
    channels : dimension of the residual
    """
    tails = np.log(variance + squared / DEGREES_OF_FREEDOM)
    return -0.5 * ((DEGREES_OF_FREEDOM + channels) * tails - DEGREES_OF_FREEDOM * np.log(variance))


def scatter(residuals: np.ndarray) -> np.ndarray:
    """Scatter matrix (C, C) of zero-mean ``residuals`` (N, C), by EM (Liu and Rubin, 1995).

    It is robust, whereas a covariance is inflated by the few residuals at first contact.
    """
    count, channels = residuals.shape
    matrix = residuals.T @ residuals / max(count, 1)
    floor = np.diag(np.maximum(1e-9 * matrix.diagonal(), np.finfo(np.float64).tiny ** 0.25))
    for _ in range(_ITERATIONS):
        solved = np.linalg.solve(matrix + floor, residuals.T)
        squared = np.einsum("nc,cn->n", residuals, solved)
        weights = (DEGREES_OF_FREEDOM + channels) / (DEGREES_OF_FREEDOM + squared)
        matrix = (weights[:, None] * residuals).T @ residuals / max(count, 1)
    return matrix
