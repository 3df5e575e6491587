"""Evidence for the map on material that is felt everywhere: correlation along a trajectory.

A signal is not evidence of the map because noise does not explain it: other material gives a signal as well.
So the correlation of the innovations of the strain with those of the map along the trajectory of the estimate
is compared with the correlations along trajectories elsewhere on the map, which show how large it is by
chance. It depends on no offset, drift, gain or noise width.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

MEMORY = 0.3
"""m of travel over which the weight of a strain in the correlation falls to 1/e. By judgement, not varied."""
PRIOR = 2.2
"""nats against the map. By judgement; with 1, 3 and 4.4 none of 174 to 232 starts on other fabrics converged
(four fabrics), and own ones did 2 mm earlier or later."""
AWAY = 0.01
"""m from the estimate beyond which a place is elsewhere: the signal of fabrics is correlated over less."""
_LARGEST_ENERGY = 0.5
"""Energy per channel, in variances, above which an innovation is shortened: no short burst decides the
correlation, like the start of a slide, which is alike on all fabrics. By judgement; 0.5 and 2 were equal."""
_LOG_RELOCATED = math.log(100.0)
"""Largest logarithm of the odds of the map to chance for a hand that was placed elsewhere. By judgement: of
hands relocated on twenty maps of fabric, 94, 96, 97 and 98 % were converged again within 40 mm with log(10),
log(100), log(1,000) and log(10,000); of 348 that moved on to another fabric, 2, 4, 10 and 32 % converged."""
_BEFORE = 5
"""Updates after which a trend has an average to predict from."""
_LARGEST = 0.998


class Sums(NamedTuple):
    """Weighted sums of squares and products of innovations along the R trajectories of the references.

    Parameters
    ----------
    updates : number of strains
    strain, map, product : (R,) sums
    prior : logarithm of the odds of the map to chance where the sums began
    """

    updates: int
    strain: np.ndarray
    map: np.ndarray
    product: np.ndarray
    prior: float

    @classmethod
    def start(cls, count: int) -> Sums:
        """Before the first strain, along ``count`` trajectories."""
        zero = np.zeros(count)
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
        covariance = innovations.T @ innovations / max(len(innovations), 1)
        covariance = covariance + max(variance, 1e-12) * np.eye(channels)
        self._whitening = np.linalg.inv(np.linalg.cholesky(covariance)).T.astype(np.float32)
        self._bound = _LARGEST_ENERGY * channels
        self._log_places = math.log(max(places, 1.0))

    def update(
        self, sums: Sums, strain: np.ndarray, expected: np.ndarray, variance: np.ndarray, travel: float
    ) -> Sums:
        """Take in innovations of a strain (C,) and of the map (R, C), and the variance (R,) at its places."""
        if sums.updates < _BEFORE:
            return sums._replace(updates=sums.updates + 1)
        felt, there = strain.astype(np.float32) @ self._whitening, expected @ self._whitening
        energy, energies = float(felt @ felt), np.einsum("nc,nc->n", there, there)
        products = there @ felt
        # Both are shortened by the same rule, which leaves the angle between them.
        shortened, shortenings = 1.0 / (1.0 + energy / self._bound), 1.0 / (1.0 + energies / self._bound)
        keep = math.exp(-travel / MEMORY)
        return Sums(
            sums.updates + 1,
            sums.strain * keep + energy * shortened / variance,
            sums.map * keep + energies * shortenings / variance,
            sums.product * keep + products * np.sqrt(shortened * shortenings) / variance,
            sums.prior,
        )

    def log_odds(self, sums: Sums, masses: np.ndarray, is_elsewhere: np.ndarray) -> float:
        """Logarithm of the odds of the map to chance.

        Parameters
        ----------
        masses : (R,) of the filter's belief in the box of each reference, with a sum of one
        is_elsewhere : (R,) bool, references that are :data:`AWAY` from the estimate
        """
        squared = np.minimum(sums.product**2 / np.maximum(sums.strain * sums.map, 1e-300), _LARGEST)
        length, chance = sums.strain[is_elsewhere], squared[is_elsewhere]
        evidence = 0.0
        if length.any():
            # By chance, the correlation of n independent numbers has a mean square of 1 / n.
            per_length = len(length) / max(float(length @ chance), 1e-300)
            independent = np.minimum(per_length * sums.strain, 1e4)
            gain = -0.5 * np.maximum(independent - 2.0, 0.0) * np.log1p(-squared)
            evidence = float(masses @ np.where(sums.product > 0.0, gain, 0.0))
        # The best of many places fits by chance: a belief pays for being narrower than a uniform one.
        entropy = -float(np.sum(masses * np.log(np.maximum(masses, 1e-300))))
        narrowing = min(max(math.log(len(masses)) - entropy, 0.0), self._log_places)
        return sums.prior + evidence - narrowing
