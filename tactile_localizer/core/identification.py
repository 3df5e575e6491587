"""Which feature is it? One localizer a candidate, and the probability of each from its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from tactile_localizer.core.filters.weights import normalize
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.naming import Namer

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

    *Which of them* compares how well their namers explain the strain where each candidate's belief is.
    *One of them at all* compares the mixture of the candidates with material that was never scanned. A
    candidate's evidence for this is that of the whole sequence, log P(z_1:t | candidate), tempered as in its
    filter: the sum of :class:`.Estimate`'s ``log_evidence``. A strain that is more like featureless material
    says nothing on either, for all materials have such places. Before anything was felt, none is as probable
    as all candidates together. What is remembered is bounded, so that a change of material is noticed. A
    phalanx that a candidate's localizer leaves out because it contradicts its belief is no excuse: it speaks
    against that candidate.

    Parameters
    ----------
    localizers : a localizer for each candidate, over the same axes and phalanges
    namers : by the same names
    """

    _MOST = 4.0
    """nats that the most probable candidate can be ahead of any other, and one of them ahead of none."""
    _SHARE = 0.25
    """Of an independent measurement, for which strains are named once: it costs as much as a filter does."""

    def __init__(self, localizers: Mapping[str, Localizer], namers: Mapping[str, Namer]) -> None:
        self.localizers = dict(localizers)
        self._namers = dict(namers)
        self.reset()

    def reset(self) -> None:
        """Start anew: the candidates alike, and none of them as probable as all together."""
        for localizer in self.localizers.values():
            localizer.reset()
        self._log_shares = self._log_mixture = self._bounded(np.zeros(len(self.localizers)))
        self._log_odds = 0.0
        self._pending = 0.0

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Identification:
        """Feed every localizer; arguments and errors as :meth:`.Localizer.update`."""
        estimates = {
            name: localizer.update(stamp_ns, position, strain, present)
            for name, localizer in self.localizers.items()
        }
        if all(estimate.updated for estimate in estimates.values()):
            self._weigh(estimates, present)
        one_of_them = float(expit(self._log_odds))
        shares = one_of_them * np.exp(self._log_shares)
        probabilities = dict(zip(estimates, shares.tolist(), strict=True)) | {NONE: 1.0 - one_of_them}
        return Identification(probabilities, estimates)

    def _weigh(self, estimates: Mapping[str, Estimate], present: np.ndarray | None) -> None:
        each = list(estimates.values())
        unknown = float(np.mean([estimate.log_unknown for estimate in each]))
        mixture = self._log_mixture + [estimate.log_evidence - estimate.weight * unknown for estimate in each]
        gain = normalize(mixture)[1]
        self._log_mixture = self._bounded(mixture)
        if unknown <= float(np.mean([estimate.log_featureless for estimate in each])):
            return
        self._log_odds = float(np.clip(self._log_odds + gain, -self._MOST, self._MOST))
        self._pending += max(estimate.weight for estimate in each)
        if self._pending >= self._SHARE:
            self._name(estimates, present)

    def _name(self, estimates: Mapping[str, Estimate], present: np.ndarray | None) -> None:
        """Compare the candidates by the phalanges that at least one of them trusts, if there is one."""
        trusted = np.logical_or.reduce([estimate.trusted for estimate in estimates.values()])
        here = np.ones_like(trusted) if present is None else present
        felt = here & trusted if (here & trusted).any() else here
        explained = [
            self._namers[name].log_density(*localizer.hypotheses(), estimates[name].strain, felt)
            for name, localizer in self.localizers.items()
        ]
        self._log_shares = self._bounded(self._log_shares + self._pending * np.array(explained))
        self._pending = 0.0

    def _bounded(self, log_weights: np.ndarray) -> np.ndarray:
        """Normalised, the largest no more than ``_MOST`` ahead."""
        return normalize(np.maximum(log_weights, log_weights.max() - self._MOST))[0]
