"""Probability that the hand is on the material that was scanned, at a place that the map knows."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.core.filters.weights import normalize

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
    """A filter over {on the map, on unknown material, on featureless material off the map}.

    What rides off the map goes elsewhere; what returns does so uniformly. This is the only recovery. Without
    the third explanation a featureless strain would speak for the map, of which most is featureless.

    Attributes
    ----------
    probability : of being on the map
    unknown : of being on unknown material
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """On the map as probable as not."""
        self._log_weights = np.log(0.5) + np.array([0.0, *_ELSEWHERE])

    @property
    def probability(self) -> float:
        """Of being on the map."""
        return float(np.exp(self._log_weights[0]))

    @property
    def unknown(self) -> float:
        """Of being on unknown material."""
        return float(np.exp(self._log_weights[1]))

    @property
    def log_odds(self) -> float:
        """Log-odds of being on the map, nats."""
        return float(self._log_weights[0] - np.logaddexp.reduce(self._log_weights[1:]))

    def predict(self, travel: float, left: float) -> float:
        """Advance by ``travel`` metres, on which the share ``left`` of the belief left the scene.

        Returns the share of the belief on the map that has just returned.
        """
        on, elsewhere = math.exp(self._log_weights[0]), np.exp(self._log_weights[1:])
        stayed = on * (1.0 - left) * math.exp(-LEAVING_RATE * travel)
        returning = -math.expm1(-RETURN_RATE * travel)
        returned = float(elsewhere.sum()) * returning
        away = elsewhere * (1.0 - returning) + (on - stayed) * np.exp(_ELSEWHERE)
        with np.errstate(divide="ignore"):
            self._log_weights = np.log(np.array([stayed + returned, *away]))
        return returned / (stayed + returned) if returned > 0.0 else 0.0

    def update(self, log_likelihoods: np.ndarray) -> None:
        """Take in tempered log-likelihoods (3,) of a strain, in the order of the explanations."""
        weights, _ = normalize(self._log_weights + log_likelihoods)
        self._log_weights = normalize(np.maximum(weights, weights.max() - _MOST))[0]
