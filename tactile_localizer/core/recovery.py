"""Recovery: spread the belief again when what is felt contradicts it.

Augmented Monte Carlo localisation (Thrun, Burgard and Fox, "Probabilistic Robotics", 8.3.5) injects random
particles when a fast average of the likelihood falls below a slow one. Here the reference is not the past but
the null model: a belief that explains the strain worse than featureless or unknown material would is in the
wrong place.
"""

from __future__ import annotations

import math

import numpy as np


class Recovery:
    """Share of the belief to spread uniformly at each update, from the evidence.

    Parameters
    ----------
    distance : m of travel over which the log-ratio is averaged, and in which a wholly contradicted belief is
        replaced but for 1/e
    """

    _TOLERANCE = 2.0
    """Nats below the null that are put down to chance."""
    _CERTAIN = 10.0
    """Nats below the null at which the contradiction is taken as certain."""

    def __init__(self, distance: float = 0.004) -> None:
        self._distance = distance
        self.reset()

    def reset(self) -> None:
        """Forget the average."""
        self._average = 0.0

    def fraction(self, log_ratio: float, travel: float) -> float:
        """Share of the belief to spread, from the log-ratio of belief to null, nats, and the travel, m."""
        gain = -math.expm1(-travel / self._distance)
        self._average += gain * (float(np.clip(log_ratio, -20.0, 20.0)) - self._average)
        contradiction = (-self._average - self._TOLERANCE) / (self._CERTAIN - self._TOLERANCE)
        return gain * float(np.clip(contradiction, 0.0, 1.0))
