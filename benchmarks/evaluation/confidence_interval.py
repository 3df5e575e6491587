"""Bootstrap confidence intervals over sweeps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_RESAMPLES = 2000
_SEED = 20110509


class Interval(NamedTuple):
    """Mean with its 95 % confidence interval."""

    mean: float
    low: float
    high: float


def mean_interval(values: np.ndarray) -> Interval | None:
    """Mean of the finite ``values`` with its percentile bootstrap interval; ``None`` if there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    rng = np.random.default_rng(_SEED)
    means = values[rng.integers(len(values), size=(_RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Interval(float(values.mean()), float(low), float(high))
