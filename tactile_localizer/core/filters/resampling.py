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
    total = cumulative[-1]
    # Points below each sum, which are sorted like the sums: a search for every point takes twice as long.
    below = np.ceil(cumulative * (count / total) - rng.random())
    # Rounding must leave no point beyond the end, or on trailing particles of weight zero.
    below[np.searchsorted(cumulative, total, side="left") :] = count
    np.clip(below, 0.0, count, out=below)
    return np.repeat(np.arange(len(weights)), np.diff(below.astype(np.intp), prepend=0))
