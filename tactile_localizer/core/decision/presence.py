"""Probability that the hand is on the material that was scanned, at a place that the map knows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.likelihood.weights import normalize

LEAVING_RATE = 0.1
"""Times per metre of travel that a hand leaves the map: it is put down elsewhere, or the material changes.
By judgement."""
RETURN_RATE = 1.0
"""Times per metre of travel that it returns, anywhere on the map. By judgement."""
_MOST = 14.0
"""Log-odds that evidence can reach: what is a million times as probable can still be contradicted."""
_ELSEWHERE = np.log([0.5, 0.5])
"""Prior shares of unknown and of featureless material off the map."""


class Presence:
    """A filter over {on a map, on unknown material, on featureless material off the maps}.

    What rides off a map goes elsewhere; what returns does so uniformly. This is the only recovery. Without
    the last explanation a featureless strain would speak for the map, of which most is featureless.

    Parameters
    ----------
    shares : prior probabilities of the maps, given that it is one of them; several where materials are
        identified, or where a map is compared in the scan's session and in another
    """

    def __init__(self, shares: Sequence[float] = (1.0,)) -> None:
        self._shares = np.array(shares)
        self._maps = len(shares)
        self.reset()

    def reset(self) -> None:
        """On one of the maps as probable as not."""
        self._log_weights = np.log(0.5) + np.array([*np.log(self._shares), *_ELSEWHERE])

    @property
    def maps(self) -> np.ndarray:
        """Probability of being on each of the maps."""
        return np.exp(self._log_weights[: self._maps])

    @property
    def probability(self) -> float:
        """Of being on a map."""
        return float(self.maps.sum())

    @property
    def unknown(self) -> float:
        """Of being on unknown material."""
        return float(np.exp(self._log_weights[self._maps]))

    def predict(self, travel: float, left: float) -> float:
        """Advance by ``travel`` metres, on which the share ``left`` of the belief left the scene.

        Returns the share of the belief on the map that has just returned.
        """
        on, elsewhere = self.maps, np.exp(self._log_weights[self._maps :])
        stayed = on * ((1.0 - left) * math.exp(-LEAVING_RATE * travel))
        returning = -math.expm1(-RETURN_RATE * travel)
        returned = float(elsewhere.sum()) * returning
        away = elsewhere * (1.0 - returning) + float((on - stayed).sum()) * np.exp(_ELSEWHERE)
        with np.errstate(divide="ignore"):
            self._log_weights = np.log(np.array([*(stayed + returned * self._shares), *away]))
        return returned / (float(stayed.sum()) + returned) if returned > 0.0 else 0.0

    def update(self, log_likelihoods: np.ndarray) -> None:
        """Take in tempered log-likelihoods (maps + 2,) of a strain: on each map, unknown, featureless."""
        weights, _ = normalize(self._log_weights + log_likelihoods)
        self._log_weights = normalize(np.maximum(weights, weights.max() - _MOST))[0]
