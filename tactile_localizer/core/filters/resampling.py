"""Systematic resampling of particles in proportion to their weights."""

import numpy as np


def systematic(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices (count,) of the ancestors: evenly spaced points of the cumulative weights, one random offset.

    It is unbiased: the expected number of copies of particle i is ``count * weights[i]``, and of the usual
    schemes it is the fastest and has a low variance (Douc, Cappé and Moulines, "Comparison of resampling
    schemes for particle filtering", 2005).

    Parameters
    ----------
    weights : (P,) whose sum is one
    count : number of particles to draw
    rng : source of the offset
    """
    cumulative = np.cumsum(weights, dtype=np.float64)
    # Rounding must not put a point beyond the end, or on trailing particles of weight zero.
    total = cumulative[-1]
    last = int(np.searchsorted(cumulative, total, side="left"))
    points = (np.arange(count) + rng.random()) / count
    return np.minimum(np.searchsorted(cumulative, points * total, side="right"), last)
