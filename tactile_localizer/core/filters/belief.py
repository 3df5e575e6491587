"""Moments of a belief."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Belief:
    """First two moments of a belief over the state.

    ``mean`` (d,) and ``covariance`` (d, d) in m (yaw: rad), ``effective_sample_size`` of the hypotheses,
    how many ``hypotheses`` (particles or cells) are held, and the ``log_marginal`` likelihood of the
    measurement that led to it, nats.
    """

    mean: np.ndarray
    covariance: np.ndarray
    effective_sample_size: float
    hypotheses: int
    log_marginal: float = 0.0

    @property
    def trace(self) -> float:
        """Sum of the variances: the paper's measure of how peaked the belief is (III-D)."""
        return float(np.trace(self.covariance))
