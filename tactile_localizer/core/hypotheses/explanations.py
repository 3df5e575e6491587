"""Hidden Markov model over the explanations of what is felt."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.evaluation import Likelihoods
from tactile_localizer.core.likelihood.weights import log_sum, normalize

LEAVING_RATE = 0.1
"""Rate at which a hand leaves the map, per metre of travel: it is placed elsewhere, or the material changes.
By judgement."""
RELOCATION_RATE = 1.0
"""Rate at which a hand is placed anywhere on the map, from on it or from elsewhere, per metre of travel. By
judgement; with 3 the same relocated hands on five fabrics converge again, within 1 mm of the same travel."""
_SPLIT = 0.5
"""Ratio of the probabilities of *relocated* and *tracked* above which the filter takes in the belief of a
relocated hand. It moves the mean: with ratios of 0.1 to 0.3, 1 in 64 starts on two fabrics was briefly
converged with an error above 5 mm, with 0.5 none (an earlier model, and a uniform belief); relocated hands
converge again as soon with 0.25."""


class Explanations(NamedTuple):
    """Probabilities of the explanations of what is felt, with a sum of one.

    Parameters
    ----------
    tracked : the hand is on the map, where the filter follows it
    relocated : it was placed elsewhere on the map
    unknown : it is on material that was not scanned
    featureless : it is on featureless material off the map
    elsewhere : (R,) normalized log-weights of the reference places, given that the hand was relocated
    """

    tracked: float
    relocated: float
    unknown: float
    featureless: float
    elsewhere: np.ndarray

    @classmethod
    def start(cls, references: int, only_map: bool) -> Explanations:
        """Before the first strain: on the map as probable as not; surely, with ``only_map``."""
        uniform = np.full(references, -math.log(references))
        return cls(1.0, 0.0, 0.0, 0.0, uniform) if only_map else cls(0.5, 0.0, 0.25, 0.25, uniform)

    @property
    def on_map(self) -> float:
        """Probability that the map explains what is felt."""
        return self.tracked + self.relocated

    @property
    def taken_in(self) -> float:
        """Fraction of the filter's belief to be replaced by that of a relocated hand, mostly zero."""
        ratio = self.relocated / max(self.tracked, 1e-300)
        return ratio / (1.0 + ratio) if ratio > _SPLIT else 0.0

    def predict(self, travel: float, left: float) -> Explanations:
        """After ``travel`` metres, during which the fraction ``left`` of the belief moved beyond the bounds.

        Where :attr:`taken_in` is not zero, the filter has taken in the belief of a relocated hand.
        """
        tracked, relocated, unknown, featureless, elsewhere = self
        if self.taken_in:
            tracked, relocated = tracked + relocated, 0.0
        if unknown + featureless > 0.0:
            staying = math.exp(-LEAVING_RATE * travel)
            gone = tracked * (1.0 - (1.0 - left) * staying) + relocated * (1.0 - staying)
            tracked, relocated = tracked * (1.0 - left) * staying, relocated * staying
            unknown, featureless = unknown + 0.5 * gone, featureless + 0.5 * gone
        moved = -math.expm1(-RELOCATION_RATE * travel)
        arriving = moved * (tracked + unknown + featureless)
        remaining = 1.0 - moved
        uniform = math.log(max(arriving, 1e-300) / len(elsewhere))
        elsewhere = np.logaddexp(math.log(max(relocated, 1e-300)) + elsewhere, uniform)
        return Explanations(
            tracked * remaining,
            relocated + arriving,
            unknown * remaining,
            featureless * remaining,
            normalize(elsewhere)[0],
        )

    def update(
        self, tracked: float, likelihoods: Likelihoods, is_elsewhere: np.ndarray, exponent: float
    ) -> Explanations:
        """Take in log-likelihoods of a strain, of which ``exponent`` is an independent measurement.

        Parameters
        ----------
        tracked : log-likelihood of the filter's belief
        likelihoods : those of the references and of material off the map
        is_elsewhere : (R,) bool, references so far from the estimate that a hand there is not tracked
        """
        references = np.where(is_elsewhere, exponent * likelihoods.references, -math.inf)
        elsewhere, relocated = normalize(self.elsewhere + references)
        logs = np.array(
            [
                _log(self.tracked) + exponent * tracked,
                _log(self.relocated) + relocated,
                _log(self.unknown) + exponent * likelihoods.unknown,
                _log(self.featureless) + exponent * likelihoods.featureless,
            ]
        )
        total = log_sum(logs)
        if total == -math.inf:  # impossible for all: nothing was learned
            return self
        probabilities = np.exp(logs - total).tolist()
        weights = dict(zip(Explanations._fields, probabilities, strict=False))
        return Explanations(**weights, elsewhere=elsewhere)


def _log(probability: float) -> float:
    return math.log(probability) if probability > 0.0 else -math.inf
