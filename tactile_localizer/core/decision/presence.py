"""Probability that the hand is on the material that was scanned, and at a place that the map knows."""

from __future__ import annotations

import math

LEAVING_RATE = 0.1
"""Times per metre of travel that a hand leaves the map: it is put down elsewhere, or the material changes.
By judgement."""
RETURN_RATE = 1.0
"""Times per metre of travel that it returns, anywhere on the map. By judgement."""
_MOST = 14.0
"""Log-odds that evidence can reach: what is a million times as probable can still be contradicted."""


class Presence:
    """A two-state filter: on the map, or elsewhere.

    What rides off the map goes elsewhere; what returns does so uniformly. This is the only recovery.

    Attributes
    ----------
    probability : of being on the map
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Both as probable as the other."""
        self.probability = 0.5

    @property
    def log_odds(self) -> float:
        """Log-odds of being on the map, nats."""
        return math.log(max(self.probability, 1e-300)) - math.log(max(1.0 - self.probability, 1e-300))

    def predict(self, travel: float, left: float) -> float:
        """Advance by ``travel`` metres, on which the share ``left`` of the belief left the scene.

        Returns the share of the belief on the map that has just returned.
        """
        on = self.probability * (1.0 - left) * math.exp(-LEAVING_RATE * travel)
        returned = (1.0 - self.probability) * -math.expm1(-RETURN_RATE * travel)
        self.probability = min(on + returned, 1.0)
        return returned / (on + returned) if returned > 0.0 else 0.0

    def update(self, log_ratio: float) -> None:
        """Take in the logarithm of the likelihood ratio of on the map to elsewhere, tempered."""
        odds = min(max(self.log_odds + log_ratio, -_MOST), _MOST)
        self.probability = 1.0 / (1.0 + math.exp(-odds))
