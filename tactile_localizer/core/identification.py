"""Which feature is it? One localizer a candidate, and the probability of each from its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.weights import normalize

NONE = "none of them"


@dataclass(frozen=True)
class Identification:
    """Probabilities of the candidates and of :data:`NONE`, which sum to one, and each one's own estimate."""

    probabilities: dict[str, float]
    estimates: dict[str, Estimate]

    @property
    def most_probable(self) -> str:
        """Name of the candidate with the highest probability, or :data:`NONE`."""
        return max(self.probabilities, key=self.probabilities.__getitem__)


class FeatureIdentifier:
    """Runs a localizer for each candidate feature and weighs them against each other and against none.

    A candidate's evidence is the tempered log-marginal of its own belief: densities over the same strain,
    which compare. *None* explains a strain as well as the candidates' nulls do on average: as featureless, or
    as badly as a map explains the worst of its own held-out sweeps. Small differences, as there are on
    featureless material, do not count. What is remembered is bounded, so that a change of material is
    noticed.

    Parameters
    ----------
    localizers : a localizer for each candidate, over the same axes and phalanges
    """

    _MOST = 12.0
    """nats that the most probable candidate can be ahead of any other."""
    _LARGEST_STEP = 20.0
    _TOLERANCE = 2.0
    """nats that any may be behind the best at no cost."""

    def __init__(self, localizers: Mapping[str, Localizer]) -> None:
        self.localizers = dict(localizers)
        self._names = (*self.localizers, NONE)
        self.reset()

    def reset(self) -> None:
        """Start anew: every candidate, and none of them, alike."""
        for localizer in self.localizers.values():
            localizer.reset()
        self._log_odds = np.zeros(len(self._names))

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Identification:
        """Feed every localizer; arguments and errors as :meth:`.Localizer.update`."""
        estimates = {
            name: localizer.update(stamp_ns, position, strain, present)
            for name, localizer in self.localizers.items()
        }
        values = list(estimates.values())
        weight = min(estimate.weight for estimate in values)
        if weight > 0.0:
            none = float(np.mean([estimate.log_null for estimate in values]))
            steps = np.array([*(estimate.log_marginal for estimate in values), none])
            self._log_odds += weight * np.clip(
                steps - steps.max() + self._TOLERANCE, -self._LARGEST_STEP, 0.0
            )
            self._log_odds = np.maximum(self._log_odds - self._log_odds.max(), -self._MOST)
        probabilities = np.exp(normalize(self._log_odds)[0])
        return Identification(dict(zip(self._names, map(float, probabilities), strict=True)), estimates)
