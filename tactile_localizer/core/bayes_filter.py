"""What the two filters have in common: predict, update, recover, and tell what is believed."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from tactile_localizer.core.credit import Credit
from tactile_localizer.core.filters.belief import Belief


class Marginal(NamedTuple):
    """Logarithms, nats, of what the belief expected of a strain.

    Parameters
    ----------
    log_likelihood : of P(z_t | z_1:t-1), with the likelihood untempered and credited
    log_evidence : of the belief's mean of the tempered likelihood; summed over the strains it is the evidence
        of the whole sequence
    """

    log_likelihood: float
    log_evidence: float


class BayesFilter(Protocol):
    """Recursive estimate of the state from displacements and strains (paper, Eq. 1 and 2)."""

    def reset(self) -> None:
        """Believe in every state of the scene alike."""

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """Believe in a Gaussian about ``mean`` (d,) with standard deviations ``std`` (d,)."""

    def predict(self, displacement: np.ndarray, travel: float) -> None:
        """Move the belief by ``displacement`` (d,), with the motion noise of ``travel`` metres."""

    def update(self, strain: np.ndarray, present: np.ndarray, exponent: float, credit: Credit) -> Marginal:
        """Weigh the belief by the likelihood of ``strain`` (C,) raised to ``exponent``.

        Parameters
        ----------
        present : (F,) bool, the phalanges that count
        credit : what the places may claim of the strain, where it is featureless
        """

    def belief(self) -> Belief:
        """Moments of the belief, after weighting and before anything is resampled or mixed in."""

    def recover(self, fraction: float) -> None:
        """Move ``fraction`` of the belief's mass to a uniform belief over the scene."""

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) that sum to one, for display."""
