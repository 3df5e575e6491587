"""Constant by which the strains of a sweep differ from those of the scan, by Kalman filters."""

from __future__ import annotations

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.evaluation import Expected
from tactile_localizer.core.likelihood.student_t import location_weight


class SweepOffset:
    """Learns the whitened offset of a sweep while the hand moves.

    The residual of a strain is averaged over the belief, and the variance of the expected strain over the
    belief counts as noise: while the position is open, little is learned.

    Parameters
    ----------
    layout : channels of each phalanx
    variance : (C,) whitened variance of the offsets of the scan's sweeps

    Attributes
    ----------
    mean, variance : (C,) of the offset
    is_learned : whether there is any variance to learn from
    """

    def __init__(self, layout: ChannelLayout, variance: np.ndarray) -> None:
        self._layout, self._prior = layout, variance
        self.is_learned = bool(variance.any())
        self.reset()

    def reset(self) -> None:
        """Start a new sweep."""
        self.mean = np.zeros(len(self._prior))
        self.variance = self._prior.copy()

    def phalanx_variance(self) -> np.ndarray:
        """Mean variance of each phalanx's channels, (F,)."""
        return self._layout.mean(self.variance)

    def update(self, expected: Expected, used: np.ndarray, exponent: float) -> None:
        """Take in one strain, compared with its expectation.

        Parameters
        ----------
        used : (F,) bool, phalanges that count
        exponent : tempering exponent of this strain
        """
        counts = self._layout.widths
        noise = self._layout.expand(expected.noise)
        total = self.variance + expected.spread + noise
        surprise = self._layout.sum(expected.residual**2 / total)
        weight = location_weight(surprise, counts) * used
        observed = (expected.spread + noise) / max(exponent, 1e-6)
        gain = self._layout.expand(weight) * self.variance / np.maximum(self.variance + observed, 1e-300)
        self.mean = self.mean + gain * expected.residual
        self.variance = self.variance * (1.0 - gain)
