"""What a measurement model says of one strain: the value that filters and decisions take."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Evaluation(NamedTuple):
    """Log-likelihoods of one strain, nats, under P hypotheses with K components each, and of alternatives.

    Parameters
    ----------
    position : (P, K) for *where* on the map the hand is, given the earlier residuals of each hypothesis
    marginal : (P, K, F) by phalanx, without memory, for *whether* the hand is on the map at all
    inflated : (P, K, F) the same with a larger variance: the map's place, but other material
    elsewhere : mean over all places of the map of the inflated likelihood
    log_prior : (P, K) of the components at these states
    residual : (P, K, C) whitened strain less its expectation
    variance : (P, K, F) of that residual
    memory : (P, K, C) slow part of the residual after this strain
    """

    position: np.ndarray
    marginal: np.ndarray
    inflated: np.ndarray
    elsewhere: float
    log_prior: np.ndarray
    residual: np.ndarray
    variance: np.ndarray
    memory: np.ndarray
