"""Log-weights: normalization, effective sample size, moments."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle


def normalize(log_weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Scale weights to sum to one.

    Parameters
    ----------
    log_weights : (P,) logarithms; ``-inf`` is a weight of zero

    Returns
    -------
    normalized : (P,) logarithms of weights that sum to one; equal weights if all were zero
    log_total : logarithm of the sum before; ``-inf`` if all weights were zero
    """
    peak = float(log_weights.max())
    if peak == -math.inf:
        return np.full_like(log_weights, -math.log(len(log_weights))), -math.inf
    # The peak is subtracted first, so that large log-weights are not rounded.
    scaled = log_weights - peak
    log_sum = math.log(float(np.exp(scaled).sum()))
    return scaled - log_sum, peak + log_sum


def effective_sample_size(log_weights: np.ndarray) -> float:
    """Kish's effective sample size of normalized ``log_weights`` (P,), 1 / sum of squares: 1 to P."""
    return float(1.0 / np.sum(np.exp(2.0 * log_weights)))


def moments(states: np.ndarray, weights: np.ndarray, wraps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of weighted states.

    Parameters
    ----------
    states : (P, d)
    weights : (P,) that sum to one
    wraps : (d,) bool, full-turn axes: their mean is the circular one, and deviations follow the shortest arc

    Returns
    -------
    mean : (d,)
    covariance : (d, d)
    """
    mean = weights @ states
    if wraps.any():
        angles = states[:, wraps]
        mean[wraps] = np.arctan2(weights @ np.sin(angles), weights @ np.cos(angles))
    deviation = states.T - mean[:, None]
    if wraps.any():
        deviation[wraps] = wrap_angle(deviation[wraps])
    return mean, (deviation * weights) @ deviation.T
