"""What a believed place may claim of a strain that is featureless."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Credit(NamedTuple):
    """Makes the map's explanation of a featureless strain comparable with the position-blind one.

    Kernels blur: where the map holds nothing but featureless strains it gives most of them a lower density
    than a Gaussian fitted to them all, and those in the tails a higher one. That difference says nothing of
    the place. So off the feature the belief is credited with the featureless explanation, and on the feature,
    whose region is larger than what is touched in every sweep, the map is lifted by what its blur takes from
    featureless strains, and no higher.

    Parameters
    ----------
    featureless : log-density of the strain on featureless material, nats
    blurred : the same, as the map blurs it, nats
    new_sweep : the same, with the offset of the sweep as uncertain as it still is, nats
    """

    featureless: float
    blurred: float
    new_sweep: float = -math.inf

    @property
    def best(self) -> float:
        """The best of them, nats: what a place has to surpass for the strain to speak for it."""
        return max(self)

    def earned(self, log_likelihood: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Log-likelihoods of states, with their credit; ``off`` (same shape, bool): off the feature."""
        best = self.best
        if best == -math.inf:
            return log_likelihood
        lifted = np.minimum(log_likelihood + (best - self.blurred), best)
        return np.maximum(log_likelihood, np.where(off, best, lifted))


NO_CREDIT = Credit(-math.inf, -math.inf)
"""Of material that is not known to be featureless anywhere."""
