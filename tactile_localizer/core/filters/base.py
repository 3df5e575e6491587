"""What the grid and the particle filter have in common."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from tactile_localizer.core.filters.belief import Belief


class BayesFilter(Protocol):
    """Recursive estimate of the state from displacements and log-likelihoods (paper, Eq. 1 and 2).

    A filter owns no measurement model: :meth:`states` are what the likelihood is wanted at, and
    :meth:`update` takes it.
    """

    def reset(self) -> None:
        """Return to a uniform belief over the scene."""

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """Start from a Gaussian about ``mean`` (d,) with standard deviations ``std`` (d,), m (yaw: rad)."""

    def predict(self, displacement: np.ndarray, travel: float) -> float:
        """Move the belief by ``displacement`` (d,), with the motion noise of ``travel`` metres.

        Returns the fraction of the belief that left the scene.
        """

    def inject(self, fraction: float) -> None:
        """Replace ``fraction`` of the belief by a uniform belief over the scene."""

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) that have weight, and the logarithms (P,) of their normalised weights."""

    def ancestors(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the states of :meth:`prior` come from.

        Returns
        -------
        index : (P,) int, of the state before, in the order of the last :meth:`prior`
        share : (P,) fraction of a state's weight that the ancestor contributed; the rest was injected
        """

    def update(self, log_likelihood: np.ndarray) -> None:
        """Weight the states of :meth:`prior` by ``log_likelihood`` (P,).

        A measurement that is impossible everywhere changes nothing.
        """

    def belief(self) -> Belief:
        """Moments of the belief, after weighting and before anything is resampled or injected."""

    def mass_near(self, mean: np.ndarray, radius: np.ndarray) -> float:
        """Probability of the ellipsoid with half-axes ``radius`` (d,) about ``mean`` (d,)."""

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) that sum to one."""
