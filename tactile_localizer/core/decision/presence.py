"""Probability that the hand is on the material that was scanned, at a place that the map knows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.decision.relocation import relocation_probability
from tactile_localizer.core.likelihood.weights import MAX_LOG_ODDS

LEAVING_RATE = 0.1
"""Rate at which a hand leaves the map, per metre of travel: it is placed elsewhere, or the material changes.
By judgement."""
_LEAST = 0.03
"""Probability of the maps below which evidence does not take them, so that a long approach over featureless
material does not delay convergence: without it 90 % of the sweeps on simulated features converged within
10 mm of contact, with it 94 %. By judgement; 0.01 to 0.1 were no different on fabrics."""
_ELSEWHERE = (0.5, 0.5)
"""Prior probabilities of unknown and of featureless material, given that the hand is off the map."""


class Presence:
    """A filter over {on a map, on unknown material, on featureless material off the maps}.

    Probability that moves beyond the map's bounds leaves it, and a hand that is placed on it returns. Without
    the last explanation a featureless strain would be evidence for the map, most of which is featureless.

    Parameters
    ----------
    shares : prior probabilities of the maps, given that it is one of them; several where materials are
        identified
    """

    def __init__(self, shares: Sequence[float] = (1.0,)) -> None:
        self._shares = [float(share) for share in shares]
        self.reset()

    def reset(self) -> None:
        """On one of the maps as probable as not."""
        self._store([0.5 * share for share in (*self._shares, *_ELSEWHERE)])

    @property
    def maps(self) -> np.ndarray:
        """Probability of being on each of the maps."""
        return np.array(self._weights[: len(self._shares)])

    @property
    def probability(self) -> float:
        """Of being on a map."""
        return sum(self._weights[: len(self._shares)])

    @property
    def unknown(self) -> float:
        """Of being on unknown material."""
        return self._weights[-2]

    @property
    def featureless(self) -> float:
        """Of being on featureless material off the maps."""
        return self._weights[-1]

    def predict(self, travel: float, left: float | Sequence[float]) -> None:
        """Advance by ``travel`` metres, during which the fraction ``left`` of the belief left the scene.

        ``left`` is one number for all maps, or one for each.
        """
        # A few numbers, of which arrays would take five times as long.
        on, elsewhere = self._weights[: len(self._shares)], self._weights[len(self._shares) :]
        each_left = [left] * len(on) if isinstance(left, float | int) else left
        staying = math.exp(-LEAVING_RATE * travel)
        returning = relocation_probability(travel)
        stayed = [each * (1.0 - lost) * staying for each, lost in zip(on, each_left, strict=True)]
        gone = sum(on) - sum(stayed)
        returned = sum(elsewhere) * returning
        self._store(
            [each + returned * share for each, share in zip(stayed, self._shares, strict=True)]
            + [
                each * (1.0 - returning) + gone * share
                for each, share in zip(elsewhere, _ELSEWHERE, strict=True)
            ]
        )

    def update(self, log_likelihoods: np.ndarray) -> None:
        """Take in tempered log-likelihoods (maps + 2,) of a strain: on each map, unknown, featureless."""
        with_evidence = zip(self._weights, log_likelihoods.tolist(), strict=True)
        logs = [math.log(weight) + added if weight > 0.0 else -math.inf for weight, added in with_evidence]
        peak = max(logs)
        if peak == -math.inf:  # no explanation is possible: nothing was learned
            self._store([1.0] * len(logs))
        else:
            self._store([math.exp(max(each - peak, -MAX_LOG_ODDS)) for each in logs])
            self._raise_to_least()

    def _raise_to_least(self) -> None:
        on_map = self.probability
        if 0.0 < on_map < _LEAST:
            factor = _LEAST * (1.0 - on_map) / (on_map * (1.0 - _LEAST))
            count = len(self._shares)
            self._store([each * factor for each in self._weights[:count]] + self._weights[count:])

    def _store(self, weights: Sequence[float]) -> None:
        total = sum(weights)
        self._weights = [weight / total for weight in weights]
