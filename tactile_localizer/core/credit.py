"""What a believed place may claim of a strain that is featureless."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Credit(NamedTuple):
    """Makes the map's explanation of a featureless strain comparable with the position-blind one.

    Kernels blur: where the map holds nothing but featureless strains it still gives them a lower density than
    a Gaussian fitted to them all. That difference says nothing of the place. So off the feature the belief is
    credited with the featureless explanation, and on the feature, whose region is larger than what is touched
    in every sweep, the map is lifted by what its blur takes from featureless strains, and no higher.

    Parameters
    ----------
    featureless : log-density of the strain on featureless material, nats
    lift : what the map's blur takes from that, nats
    """

    featureless: float
    lift: float

    def earned(self, log_likelihood: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Log-likelihoods of states, with their credit; ``off`` (same shape, bool): off the feature."""
        lifted = np.minimum(log_likelihood + self.lift, self.featureless)
        return np.maximum(log_likelihood, np.where(off, self.featureless, lifted))


NO_CREDIT = Credit(-math.inf, 0.0)
"""Of material that is not known to be featureless anywhere."""
