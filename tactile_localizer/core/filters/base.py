"""What the grid and the particle filter have in common."""

from typing import NamedTuple, Protocol

import numpy as np

from tactile_localizer.core.filters.belief import Belief


class Prediction(NamedTuple):
    """The belief after a motion, before the measurement.

    Parameters
    ----------
    states : (P, d) that have weight, m (yaw: rad)
    weights : (P,) with a sum of one
    ancestors : (P,) int, index of the state of the last prediction from which each comes
    continued : (P,) fraction of each state's weight that comes from its ancestor; the rest was taken in
    left : fraction of the belief that left the scene
    """

    states: np.ndarray
    weights: np.ndarray
    ancestors: np.ndarray
    continued: np.ndarray
    left: float


class BayesFilter(Protocol):
    """Recursive estimate of the state from displacements and log-likelihoods (paper, Eq. 1 and 2).

    A filter owns no measurement model: a prediction has the states at which the likelihood is wanted, and
    :meth:`update` takes it.
    """

    def reset(self) -> None:
        """Return to a uniform belief over the scene."""

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """Start from a Gaussian about ``mean`` (d,) with standard deviations ``std`` (d,), m (yaw: rad)."""

    def predict(self, displacement: np.ndarray, travel: float, injected: float = 0.0) -> Prediction:
        """Move the belief by ``displacement`` (d,), with the motion noise of ``travel`` metres.

        Then a fraction ``injected`` of it is replaced by a uniform one.
        """

    def update(self, log_likelihood: np.ndarray) -> Belief:
        """Weight the predicted states by ``log_likelihood`` (P,); returns moments, before any resampling.

        A measurement that is impossible everywhere changes nothing.
        """

    def weights(self) -> np.ndarray:
        """Weights (P,) of the predicted states after the update, with a sum of one."""

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) that sum to one."""
