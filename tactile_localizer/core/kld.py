"""How many particles a belief needs: KLD sampling.

Fox, "Adapting the sample size in particle filters" (2003).
"""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.scene import Scene

_BINS = 32
"""Bins along each axis of the scene."""
_ERROR = 0.05
"""Bound on the Kullback-Leibler divergence between the particles and the belief."""
_QUANTILE = 2.33
"""Standard normal quantile of the probability, 0.99, with which the bound holds."""
_FEWEST = 20


def kld_sample_size(states: np.ndarray, weights: np.ndarray, scene: Scene, most: int) -> int:
    """Particles that keep the divergence within bounds for a belief on as many bins as this one occupies.

    Parameters
    ----------
    states, weights : (P, d) and (P,), the belief
    scene : its bounds set the bins
    most : upper limit

    Returns
    -------
    Between 20 (or ``most``, where that is less) and ``most``.
    """
    heavy = weights > 1e-3 / len(weights)
    scaled = (states[heavy] - scene.lower) / (scene.upper - scene.lower)
    bins = np.floor(scaled * _BINS).astype(np.int64)
    occupied = len(np.unique(bins, axis=0))
    if occupied <= 1:
        return min(_FEWEST, most)
    k = occupied - 1.0
    # Wilson-Hilferty approximation of the chi-square quantile (Fox, Eq. 7).
    term = 2.0 / (9.0 * k)
    needed = k / (2.0 * _ERROR) * (1.0 - term + math.sqrt(term) * _QUANTILE) ** 3
    return int(min(max(math.ceil(needed), _FEWEST), most))
