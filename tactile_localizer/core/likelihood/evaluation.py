"""Likelihoods of a strain vector under all hypotheses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

INFLATION = 9.0
"""Factor by which the variance of unknown material exceeds that of the map. By judgement; tried on two
fabrics and three simulated features."""


class Likelihoods(NamedTuple):
    """Log-likelihoods of one strain vector, nats, on the map and under the alternatives to it.

    All are densities over the same strains with the same noise model, and therefore comparable.

    Parameters
    ----------
    states : (P,) at each state of the filter
    references : (R,) at each of the places that represent the whole map
    unknown : of unknown material, with a larger variance: half resembles the places of the belief, half any
        place of the map
    featureless : of featureless material; ``-inf`` if the scanned material is felt everywhere
    """

    states: np.ndarray
    references: np.ndarray
    unknown: float
    featureless: float
