"""Strain that comes from two sensors in turn, as where two devices have one name."""

import numpy as np

_MIN_COUNT = 50
"""Number of samples below which nothing is said."""
_ALTERNATING = 3.0
"""Root mean square of the steps from a sample to the next, by that of the steps to the one after, from which
strain alternates: noise has 1, motion less, and mains that is sampled twice in a period up to 2."""


def alternates(strain: np.ndarray) -> bool:
    """Whether samples are nearer to the one after the next than to the next, as those of two sensors are.

    Parameters
    ----------
    strain : (n, C) samples in their order; those that are not finite are left out
    """
    strain = strain[np.isfinite(strain).all(axis=1)]
    if len(strain) < _MIN_COUNT:
        return False
    one, two = (np.sqrt(np.mean((strain[lag:] - strain[:-lag]) ** 2)) for lag in (1, 2))
    return bool(one > _ALTERNATING * two)
