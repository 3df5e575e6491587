"""Which of several scanned materials is it, and where on it: one filter over all maps and none of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.decision.convergence import ConvergenceCriteria, State
from tactile_localizer.core.decision.presence import Presence
from tactile_localizer.core.likelihood.weights import MAX_LOG_ODDS, log_sum
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.scene import Scene

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
    """Runs a localizer for each candidate and a :class:`.Presence` over all of their maps.

    The likelihood of a candidate is that of the strain on its map, averaged over its localizer's belief;
    unknown and featureless material follow the model of one of the localizers, which is learned. They can be
    compared because the localizers share one noise model (:func:`.learn_comparable`).

    Parameters
    ----------
    localizers : a localizer for each candidate, over the same axes and phalanges
    """

    def __init__(self, localizers: Mapping[str, Localizer]) -> None:
        self.localizers = dict(localizers)
        self._presence = Presence(np.full(len(self.localizers), 1.0 / len(self.localizers)).tolist())
        self._alternatives = [Mixture(len(self.localizers)) for _ in range(2)]
        self.reset()

    def reset(self) -> None:
        """Return to the prior: equal candidates, and none of them as probable as all together."""
        for localizer in self.localizers.values():
            localizer.reset()
        self._begin()

    def _begin(self) -> None:
        self._presence.reset()
        for mixture in self._alternatives:
            mixture.reset()
        self._travel = 0.0

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Identification:
        """Feed every localizer; arguments and errors as :meth:`.Localizer.update`."""
        estimates = {
            name: localizer.update(stamp_ns, position, strain, present)
            for name, localizer in self.localizers.items()
        }
        each = list(estimates.values())
        if all(estimate.updated for estimate in each):
            self._compare(each)
        probabilities = dict(zip(estimates, self._presence.maps.tolist(), strict=True))
        return Identification(probabilities | {NONE: 1.0 - self._presence.probability}, estimates)

    def _compare(self, estimates: list[Estimate]) -> None:
        travel = max(estimate.travel for estimate in estimates)
        if travel < self._travel:  # the localizers were reset
            self._begin()
        # A hand that is known to ride off a map is still on its material.
        left = [
            0.0 if estimate.state in (State.CONVERGED, State.LOST) else localizer.left
            for estimate, localizer in zip(estimates, self.localizers.values(), strict=True)
        ]
        self._presence.predict(travel - self._travel, left)
        self._travel = travel
        exponent = min(estimate.exponent for estimate in estimates)
        logs = [(each.log_marginal, each.log_elsewhere, each.log_featureless) for each in estimates]
        on_map, *alternatives = exponent * np.array(logs).T
        mixtures = zip(self._alternatives, alternatives, strict=True)
        evidence = [mixture.update(log_likelihoods) for mixture, log_likelihoods in mixtures]
        self._presence.update(np.array([*on_map, *evidence]))


class Mixture:
    """Evidence for one of several explanations that holds throughout a sweep, when it is not known which.

    Parameters
    ----------
    count : number of explanations, all alike at first
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self.reset()

    def reset(self) -> None:
        """Give all explanations the same weight."""
        self._log_weights = np.full(self._count, -np.log(self._count))

    def update(self, log_likelihoods: np.ndarray) -> float:
        """Log-likelihood of a strain, from those (count,) under each explanation."""
        joint = self._log_weights + log_likelihoods
        total = log_sum(joint)
        if total > -np.inf:
            self._log_weights = np.maximum(joint - total, -MAX_LOG_ODDS)
        return total


class FeatureLocalizer:
    """Has what a :class:`.Localizer` has, over several candidates: the estimate on the most probable one.

    Parameters
    ----------
    identifier : runs the candidates

    Attributes
    ----------
    identification : the last one; ``None`` before the first strain
    """

    def __init__(self, identifier: FeatureIdentifier) -> None:
        self._identifier = identifier
        self._shown = next(iter(identifier.localizers))
        self.identification: Identification | None = None

    @property
    def scene(self) -> Scene:
        """Of the most probable candidate."""
        return self._identifier.localizers[self._shown].scene

    def reset(self) -> None:
        """Return to all candidates and all states alike."""
        self._identifier.reset()
        self.identification = None

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """On every candidate, start from a Gaussian about ``mean`` (d,) with deviations ``std`` (d,)."""
        self._identifier.reset()
        for localizer in self._identifier.localizers.values():
            localizer.seed(mean, std)
        self.identification = None

    def adjust(self, criteria: ConvergenceCriteria, update_distance: float) -> None:
        """As :meth:`.Localizer.adjust`, of every candidate."""
        for localizer in self._identifier.localizers.values():
            localizer.adjust(criteria, update_distance)

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) on the most probable candidate."""
        return self._identifier.localizers[self._shown].hypotheses()

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Estimate:
        """As :meth:`.Localizer.update`; on none of the candidates no position is converged."""
        self.identification = self._identifier.update(stamp_ns, position, strain, present)
        most_probable = self.identification.most_probable
        if most_probable == NONE:
            estimate = self.identification.estimates[self._shown]
            state = State.UNKNOWN if estimate.state is State.CONVERGED else estimate.state
            return estimate._replace(state=state, reason="not converged: none of the features")
        self._shown = most_probable
        return self.identification.estimates[most_probable]
