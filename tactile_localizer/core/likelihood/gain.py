"""Gain of a sweep: the factor of its signal, which differs from the scan's as the squeezing force does."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.ancestry import Ancestry

LEAST_VARIANCE = 0.03
"""Least variance of the gain: another session, with another force, differs more than the sweeps of a scan. By
judgement."""
RECENT = 0.02
"""m of travel over which the force of a sweep changes, and over which it is judged how its strain differs
from that of the scan: longer than a feature. By judgement."""


class Gain(NamedTuple):
    """Mean and variance of the gain of F phalanges, along N trajectories: ``moments`` (2, F, N) float32.

    The gain g is a Gauss-Markov process about one. Along a trajectory, a strain whose innovation is g u +
    noise, with u that of the map, is a linear measurement of it: a scalar Kalman filter.
    """

    moments: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """The mean (F, N)."""
        return self.moments[0]

    @property
    def variance(self) -> np.ndarray:
        """The variance (F, N)."""
        return self.moments[1]

    @classmethod
    def start(cls, phalanges: int, count: int, variance: float) -> Gain:
        """Before the first strain, along ``count`` trajectories."""
        moments = np.ones((2, phalanges, count), dtype=np.float32)
        moments[1] = variance
        return cls(moments)

    def followed(self, ancestry: Ancestry) -> Gain:
        """The gain along the trajectories that continue these."""
        two, phalanges, count = self.moments.shape
        found = ancestry.followed(self.moments.reshape(two * phalanges, count))
        return Gain(found.reshape(two, phalanges, -1))

    def predicted(self, travel: float, prior: float) -> Gain:
        """The gain after ``travel`` metres, over which it returns to the ``prior`` variance about one."""
        kept = math.exp(-travel / RECENT)
        rest = np.array([[[kept]], [[kept**2]]], dtype=np.float32)
        moments = rest * self.moments
        moments += np.array([[[1.0 - kept]], [[(1.0 - kept**2) * prior]]], dtype=np.float32)
        return Gain(moments)

    def updated(self, information: np.ndarray, product: np.ndarray, exponent: float) -> Gain:
        """The gain after a strain.

        Parameters
        ----------
        information : (F, N) u'u / A, with the innovation u of the map and the variance A
        product : (F, N) u'r / A, with the residual r at the mean gain
        exponent : fraction of an independent measurement that the strain is
        """
        variance = self.variance / (1.0 + exponent * self.variance * information)
        return Gain(np.stack([self.mean + exponent * variance * product, variance]))
