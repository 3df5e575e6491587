"""Resampling of particles in proportion to their weights.

The schemes are described by Douc, Cappé and Moulines, "Comparison of resampling schemes for particle
filtering" (2005). Each maps weights (P,) that sum to one to the indices (count,) of the ancestors, and is
unbiased: the expected number of copies of particle i is ``count * weights[i]``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def systematic(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Evenly spaced points with one random offset: low variance at the lowest cost."""
    return representative(weights, count, rng.random())


def multinomial(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Independent draws, with the highest variance."""
    return _ancestors(weights, np.sort(rng.random(count)))


RESAMPLERS: dict[str, Callable[[np.ndarray, int, np.random.Generator], np.ndarray]] = {
    "systematic": systematic,
    "multinomial": multinomial,
}


def representative(weights: np.ndarray, count: int, offset: float = 0.5) -> np.ndarray:
    """Evenly spaced points with an ``offset`` in [0, 1), by default a deterministic sample."""
    return _ancestors(weights, (np.arange(count) + offset) / count)


def _ancestors(weights: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Indices of the particles at the ascending ``points`` in [0, 1) of the cumulative weights."""
    cumulative = np.cumsum(weights, dtype=np.float64)
    # Rounding must not put a point beyond the end, or on trailing particles of weight zero.
    total = cumulative[-1]
    last = int(np.searchsorted(cumulative, total, side="left"))
    return np.minimum(np.searchsorted(cumulative, points * total, side="right"), last)
