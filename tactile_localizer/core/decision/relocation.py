"""Whether the hand was put down elsewhere on the map: the detection of a change (Shiryaev, 1963)."""

from __future__ import annotations

import math

from tactile_localizer.core.likelihood.weights import MAX_LOG_ODDS

PUT_DOWN_RATE = 1.0
"""Times per metre of travel that the hand is put down anywhere on the map, from off the map or from on it. By
judgement."""
_WORTH_INJECTING = 0.5
"""Odds above which the belief takes it in. Uniform mass moves the mean: with 0.1 to 0.3, 1 in 64 starts on
two fabrics was converged and 5 mm off for a moment, with 0.5 none. With 1, a hand that was put down elsewhere
was found 2 mm later."""


class Relocation:
    """Odds that the hand has been put down elsewhere on the map since the belief was last made uniform there.

    Below a limit nothing is injected, so the belief about a hand that is tracked stays undisturbed. The
    likelihood of a strain at places without belief is approximated by that of unknown material.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Set the odds to zero, for a belief that is uniform or seeded."""
        self._odds = 0.0

    def predict(self, travel: float, on_map: float) -> float:
        """Advance by ``travel`` metres with probability ``on_map`` of the map.

        Returns the fraction of the belief that is to be replaced by a uniform one, mostly zero.
        """
        self._odds += put_down(travel) / max(on_map, 1e-9)
        if self._odds < _WORTH_INJECTING:
            return 0.0
        fraction = self._odds / (1.0 + self._odds)
        self._odds = 0.0
        return fraction

    def update(self, log_ratio: float) -> None:
        """Take in the tempered log-likelihood ratio of a strain, of the belief to unknown material."""
        if not math.isnan(log_ratio):  # of a strain that is impossible for both
            self._odds *= math.exp(min(max(-log_ratio, -MAX_LOG_ODDS), MAX_LOG_ODDS))


def put_down(travel: float) -> float:
    """Probability that a hand is put down anywhere on the map within ``travel`` metres."""
    return -math.expm1(-PUT_DOWN_RATE * travel)
