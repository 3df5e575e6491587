"""Weights of hypotheses and of their components, kept as logarithms."""

from __future__ import annotations

import numpy as np


def switched(log_weights: np.ndarray, log_prior: np.ndarray, probability: float) -> np.ndarray:
    """Log-weights (P, K) with each hypothesis' component drawn anew with ``probability``.

    Parameters
    ----------
    log_weights : (P, K)
    log_prior : (P, K) of the components, normalised over them
    """
    if log_weights.shape[1] == 1 or probability <= 0.0:
        return log_weights
    total = np.logaddexp.reduce(log_weights, axis=1, keepdims=True)
    with np.errstate(divide="ignore"):
        kept = log_weights + np.log1p(-probability)
    return np.asarray(np.logaddexp(kept, total + log_prior + np.log(probability)))
