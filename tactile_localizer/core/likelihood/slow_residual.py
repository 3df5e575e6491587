"""The slow part of the residual: a first-order autoregressive process with a white share, by Kalman filter.

Residuals along a sweep are correlated: where one strain was larger than the map says, the next one is too.
Each strain is judged by its innovation, what the last residuals did not let one expect.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Filtering(NamedTuple):
    """One step of the filter, the same for all hypotheses, in units of the variance of the residual.

    Parameters
    ----------
    decay : what is left of the slow part after the travel
    gain : share of the innovation that is taken for slow
    innovation_variance : of the innovation
    """

    decay: float
    gain: float
    innovation_variance: float


class SlowResidual:
    """Steps of the Kalman filter of a process with unit variance.

    Parameters
    ----------
    correlation_length : m over which the slow part decays to 1/e
    white_share : share of the variance that is white
    """

    def __init__(self, correlation_length: float, white_share: float) -> None:
        self._length = correlation_length
        self._white = white_share
        self.reset()

    def reset(self) -> None:
        """Nothing is known of the slow part."""
        self._variance = 1.0 - self._white

    def step(self, travel: float) -> Filtering:
        """Advance by ``travel`` metres and take in one strain."""
        decay = math.exp(-travel / self._length)
        predicted = decay**2 * self._variance + (1.0 - decay**2) * (1.0 - self._white)
        innovation = predicted + self._white
        self._variance = predicted * self._white / innovation
        return Filtering(decay, predicted / innovation, innovation)
