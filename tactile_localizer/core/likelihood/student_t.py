"""Multivariate Student-t distribution, of the difference between two visits to a place."""

import numpy as np

DEGREES_OF_FREEDOM = 8.0
"""Heavy enough that single outliers of several standard deviations hardly change the belief. By judgement."""

_ITERATIONS = 25


def mahalanobis(
    squared: np.ndarray, variance: np.ndarray, projected: np.ndarray, total: np.ndarray
) -> np.ndarray:
    """Squared Mahalanobis length of a residual r.

    The scale matrix is A I + g m m', in units of the whitened variance, with m the signal and g the variance
    of the gain by which visits differ in it.

    Parameters
    ----------
    squared : (...) r'r
    variance : (...) A
    projected : (...) g (m'r)^2
    total : (...) A + g m'm, the variance along the signal
    """
    left = np.maximum(squared - projected / total, 0.0)  # rounded, it could be negative
    return np.asarray(left / variance)


def log_density(
    squared: np.ndarray, variance: np.ndarray, total: np.ndarray, channels: int | np.ndarray
) -> np.ndarray:
    """Log-density of a residual up to a constant that depends on ``channels`` alone.

    Parameters
    ----------
    squared : (...) its squared Mahalanobis length, :func:`mahalanobis`
    variance, total : (...) variances in the other directions and along the signal, as there
    channels : dimension of the residual
    """
    tails = (DEGREES_OF_FREEDOM + channels) * np.log(1.0 + squared * (1.0 / DEGREES_OF_FREEDOM))
    return np.asarray(-0.5 * (tails + (channels - 1.0) * np.log(variance) + np.log(total)))


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
