"""Evidence for the map on material that is felt everywhere: correlation along the path of the belief.

A signal is not evidence of the map because noise does not explain it: other material gives a signal as well.
So the correlation of the innovations of the strain with those that the predicted belief expects is compared
with the correlations along rigid trajectories elsewhere on the map, which show how large it is by chance. It
depends on no offset, drift, gain or noise width. The belief follows the palm where the odometry is wrong, and
it is the one *before* each strain, so that it has not chosen a place by that strain.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np

MEMORY = 0.3
"""m of travel over which the weight of a strain in the correlation falls to 1/e. By judgement."""
PRIOR = 2.2
"""nats against the map. By judgement."""
AWAY = 0.01
"""m from the estimate beyond which a place is elsewhere: the signal of fabrics is correlated over less."""
_LARGEST_ENERGY = 0.5
"""Energy per channel, in variances, above which an innovation is shortened: no short burst decides the
correlation, like the start of a slide, which is alike on all fabrics. By judgement."""
_LOG_RELOCATED = math.log(100.0)
"""Largest logarithm of the odds of the map to chance for a hand that was placed elsewhere: the larger, the
sooner is it converged again, and the more often on other material. By judgement."""
_BEFORE = 5
"""Updates after which a trend has an average to predict from."""
_LARGEST = 0.998


class Sums(NamedTuple):
    """Weighted sums of squares and products of innovations, along the belief and the R anchors.

    Parameters
    ----------
    updates : number of strains
    strain, map, product : (1 + R,) sums, of the belief first
    prior : logarithm of the odds of the map to chance where the sums began
    """

    updates: int
    strain: np.ndarray
    map: np.ndarray
    product: np.ndarray
    prior: float

    @classmethod
    def start(cls, count: int) -> Sums:
        """Before the first strain, along the belief and ``count`` anchors."""
        zero = np.zeros(1 + count)
        return cls(0, zero, zero, zero, -PRIOR)

    def relocated(self, log_odds: float) -> Sums:
        """The sums of a hand that was placed elsewhere, with the odds before it as the prior: nothing yet."""
        zero = np.zeros_like(self.strain)
        return Sums(self.updates, zero, zero, zero, min(log_odds, _LOG_RELOCATED))


class Correlation:
    """Probability that the map, rather than chance, explains how the strain changes along the travel.

    Parameters
    ----------
    innovations : (n, C) of the map along the sweeps of the scan
    variance : variance of the innovation of a strain about that of the map, per channel
    places : number of distinguishable places, length of the map by the correlation length of its signal
    """

    def __init__(self, innovations: np.ndarray, variance: float, places: float) -> None:
        channels = innovations.shape[1]
        self._signal = innovations.T @ innovations / max(len(innovations), 1)
        self._variance = max(variance, 1e-12)
        self._bound = _LARGEST_ENERGY * channels
        self._log_places = math.log(max(places, 1.0))
        self._whiten(np.eye(channels))

    def _whiten(self, noise: np.ndarray) -> None:
        covariance = self._signal + self._variance * noise
        self._whitening = np.linalg.inv(np.linalg.cholesky(covariance)).T.astype(np.float32)

    def with_noise(self, noise: np.ndarray) -> Correlation:
        """The same where the noise of a visit has the covariance ``noise`` (C, C), in units of the scan's."""
        noisier = copy.copy(self)
        noisier._whiten(noise)
        return noisier

    def update(
        self,
        sums: Sums,
        strain: np.ndarray,
        expected: np.ndarray,
        variance: np.ndarray,
        weights: np.ndarray,
        travel: float,
    ) -> Sums:
        """Take in an innovation of the strain.

        Parameters
        ----------
        strain : (C,) innovation
        expected, variance : (N, C) innovations of the map at the P states, then at the R anchors, and
            their variances (N,)
        weights : (P,) of the states before this strain
        travel : m since the last update
        """
        if sums.updates < _BEFORE:
            return sums._replace(updates=sums.updates + 1)
        felt, there = strain.astype(np.float32) @ self._whitening, expected @ self._whitening
        energy, energies = float(felt @ felt), np.einsum("nc,nc->n", there, there)
        # Both are shortened by the same rule, which leaves the angle between them.
        shortened, shortenings = 1.0 / (1.0 + energy / self._bound), 1.0 / (1.0 + energies / self._bound)
        found = np.array([np.full(len(there), energy * shortened), energies * shortenings, there @ felt])
        found[2] *= np.sqrt(shortened * shortenings)
        found /= variance
        states = len(weights)
        along = np.column_stack([found[:, :states] @ weights, found[:, states:]])
        keep = math.exp(-travel / MEMORY)
        strain_sum, map_sum, product = (
            keep * before + now for before, now in zip(sums[1:4], along, strict=True)
        )
        return Sums(sums.updates + 1, strain_sum, map_sum, product, sums.prior)

    def log_odds(self, sums: Sums, masses: np.ndarray, far: np.ndarray) -> float:
        """Logarithm of the odds of the map to chance.

        Parameters
        ----------
        masses : (R,) of the filter's belief in the box of each anchor, with a sum of one
        far : (R,) bool, anchors that are :data:`AWAY` from the estimate
        """
        squared = np.minimum(sums.product**2 / np.maximum(sums.strain * sums.map, 1e-300), _LARGEST)
        length, chance = sums.strain[1:][far], squared[1:][far]
        evidence = 0.0
        if length.any() and sums.product[0] > 0.0:
            # By chance, the correlation of n independent numbers has a mean square of 1 / n.
            per_length = len(length) / max(float(length @ chance), 1e-300)
            independent = min(per_length * float(sums.strain[0]), 1e4)
            evidence = -0.5 * max(independent - 2.0, 0.0) * math.log1p(-float(squared[0]))
        # The best of many places fits by chance: a belief pays for being narrower than a uniform one.
        entropy = -float(np.sum(masses * np.log(np.maximum(masses, 1e-300))))
        narrowing = min(max(math.log(len(masses)) - entropy, 0.0), self._log_places)
        return sums.prior + evidence - narrowing
