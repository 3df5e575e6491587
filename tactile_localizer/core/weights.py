"""Weights: Bayes' rule, effective sample size, moments."""

import math

import numpy as np

from tactile_localizer.core import compiled
from tactile_localizer.core.geometry.angles import wrap_angle

_FEW = 500
"""States from which numpy's exponential makes up for the calls."""


def bayes(prior: np.ndarray, log_likelihood: np.ndarray) -> tuple[np.ndarray, float]:
    """Bayes' rule for weights.

    Parameters
    ----------
    prior : (P,) with a sum of one
    log_likelihood : (P,), of any size; ``-inf``: impossible

    Returns
    -------
    posterior : (P,) with a sum of one; the prior if the measurement is impossible everywhere
    log_marginal : logarithm of the likelihood's mean over the prior
    """
    if compiled.MODULE is not None and len(prior) < _FEW:
        posterior, likelihood = np.empty(len(prior)), np.ascontiguousarray(log_likelihood, dtype=np.float64)
        log_marginal = compiled.MODULE.bayes(prior, likelihood, posterior)
        return (prior if log_marginal == -math.inf else posterior), log_marginal
    has_zeros = np.minimum.reduce(prior) <= 0.0
    likelihood = np.where(prior > 0.0, log_likelihood, -math.inf) if has_zeros else log_likelihood
    peak = float(np.maximum.reduce(likelihood))
    if peak == -math.inf:
        return prior, peak
    joint = prior * np.exp(likelihood - peak)
    total = float(np.add.reduce(joint))
    joint /= total
    return joint, peak + math.log(total)


def effective_sample_size(weights: np.ndarray) -> float:
    """Kish's effective sample size of ``weights`` (P,) with a sum of one, 1 / sum of squares: 1 to P."""
    return 1.0 / float(weights @ weights)


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
    if compiled.MODULE is not None:
        axes = len(wraps)
        mean, covariance = np.empty(axes), np.empty((axes, axes))
        compiled.MODULE.moments(np.ascontiguousarray(states.T), weights, wraps, mean, covariance)
        return mean, covariance
    mean, turns = weights @ states, np.count_nonzero(wraps) > 0
    if turns:
        angles = states[:, wraps]
        mean[wraps] = np.arctan2(weights @ np.sin(angles), weights @ np.cos(angles))
    deviation = states.T - mean[:, None]
    if turns:
        deviation[wraps] = wrap_angle(deviation[wraps])
    return mean, (deviation * weights) @ deviation.T
