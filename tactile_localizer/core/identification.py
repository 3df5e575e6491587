"""Which feature is it? One localizer a candidate, and the probability of each from its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

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

    A candidate's evidence is that of the whole sequence, log P(z_1:t | candidate), tempered as in its filter:
    the sum of :class:`.Estimate`'s ``log_evidence``. *Which of them* compares these with each other. *One of
    them at all* compares their mean, by the probabilities so far, with material that was never scanned; a
    strain that is more like featureless material says nothing on this, for all materials have such places.
    Before anything was felt, none is as probable as all candidates together. What is remembered is bounded,
    so that a change of material is noticed. A phalanx that a candidate's localizer leaves out because it
    contradicts its belief is no excuse: it speaks against that candidate.

    Parameters
    ----------
    localizers : a localizer for each candidate, over the same axes and phalanges
    """

    _MOST = 4.0
    """nats that the most probable candidate can be ahead of any other, and one of them ahead of none."""

    def __init__(self, localizers: Mapping[str, Localizer]) -> None:
        self.localizers = dict(localizers)
        self.reset()

    def reset(self) -> None:
        """Start anew: the candidates alike, and none of them as probable as all together."""
        for localizer in self.localizers.values():
            localizer.reset()
        self._log_shares, _ = normalize(np.zeros(len(self.localizers)))
        self._log_odds = 0.0

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Identification:
        """Feed every localizer; arguments and errors as :meth:`.Localizer.update`."""
        estimates = {
            name: localizer.update(stamp_ns, position, strain, present)
            for name, localizer in self.localizers.items()
        }
        if all(estimate.updated for estimate in estimates.values()):
            self._weigh(list(estimates.values()))
        one_of_them = float(expit(self._log_odds))
        shares = one_of_them * np.exp(self._log_shares)
        probabilities = dict(zip(estimates, shares.tolist(), strict=True)) | {NONE: 1.0 - one_of_them}
        return Identification(probabilities, estimates)

    def _weigh(self, estimates: list[Estimate]) -> None:
        featureless = float(np.mean([estimate.log_featureless for estimate in estimates]))
        unknown = float(np.mean([estimate.log_unknown for estimate in estimates]))
        evidence = [estimate.log_evidence - estimate.weight * unknown for estimate in estimates]
        shares, gain = normalize(self._log_shares + evidence)
        self._log_shares, _ = normalize(np.maximum(shares, shares.max() - self._MOST))
        if unknown > featureless:
            self._log_odds = float(np.clip(self._log_odds + gain, -self._MOST, self._MOST))
