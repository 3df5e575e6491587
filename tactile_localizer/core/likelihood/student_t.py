"""Multivariate Student-t distribution, of the difference between two visits to a place."""

import numpy as np

DEGREES_OF_FREEDOM = 8.0
"""Heavy enough that single outliers of several standard deviations hardly change the belief. By judgement."""

_ITERATIONS = 25


def log_density(
    squared: np.ndarray,
    variance: np.ndarray,
    channels: int | np.ndarray,
    projected: np.ndarray | float = 0.0,
    gain_variance: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Log-density of a residual r up to a constant that depends on ``channels`` alone.

    The scale matrix is A I + g m m', in units of the whitened variance, with m the signal and g the variance
    of the gain by which visits differ in it.

    Parameters
    ----------
    squared : (...) r'r
    variance : (...) A
    channels : dimension of the residual
    projected, gain_variance : (...) g (m'r)^2 and g m'm
    """
    total = variance + gain_variance
    left = np.maximum(squared - projected / total, 0.0)  # rounded, it could be negative
    tails = np.log(variance + left * (1.0 / DEGREES_OF_FREEDOM))
    scale = (DEGREES_OF_FREEDOM + 1.0) * np.log(variance) - np.log(total)
    return np.asarray(-0.5 * ((DEGREES_OF_FREEDOM + channels) * tails - scale))


def weight(squared: np.ndarray, channels: int | np.ndarray | float) -> np.ndarray:
    """Weight of a residual: the expected precision, in that of the scale matrix (Liu and Rubin, 1995).

    Parameters
    ----------
    squared : (...) squared Mahalanobis length of the residual
    channels : dimension of the residual
    """
    return np.asarray((DEGREES_OF_FREEDOM + channels) / (DEGREES_OF_FREEDOM + squared))


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
        matrix = (weight(squared, channels)[:, None] * residuals).T @ residuals / max(count, 1)
    return matrix
