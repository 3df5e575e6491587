"""Combination of a measurement model for the position with the sweep mixture for presence on the map."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.evaluation import Evaluation, Expected
from tactile_localizer.core.likelihood.new_session import NewSession
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture


class KernelPosition:
    """A :class:`.StrainModel` with one of the paper's models, or a user-defined one, for the position.

    Parameters
    ----------
    model : the measurement model
    mixture : the sweep mixture of the same scan
    correlation_length : m of travel per independent measurement of the position
    """

    def __init__(self, model: MeasurementModel, mixture: SweepMixture, correlation_length: float) -> None:
        self._model, self.mixture = model, mixture
        self.information_length = correlation_length
        self.presence_length = mixture.presence_length
        self.offset_variance = mixture.offset_variance
        self.new_session: NewSession | None = None

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """See :meth:`.StrainModel.whitened`."""
        return self.mixture.whitened(strain)

    def in_volts(self, difference: np.ndarray) -> np.ndarray:
        """See :meth:`.StrainModel.in_volts`."""
        return self.mixture.in_volts(difference)

    def evaluate(
        self, states: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> Evaluation:
        """See :meth:`.StrainModel.evaluate`."""
        volts = self.mixture.in_volts(strain) + self.mixture.noise.centre
        position = self._model.log_likelihood(states, volts, used)
        return self.mixture.evaluate(states, strain, used, offset_variance)._replace(position=position)

    def expected(self, nodes: np.ndarray, log_weights: np.ndarray, strain: np.ndarray) -> Expected:
        """See :meth:`.StrainModel.expected`."""
        return self.mixture.expected(nodes, log_weights, strain)
