"""Combination of a measurement model for the position with the sweep mixture for presence on the map."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.evaluation import Evaluation
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture


class KernelPosition(SweepMixture):
    """A sweep mixture with one of the paper's models, or a user-defined one, for the position.

    Parameters
    ----------
    model : the measurement model
    mixture : the sweep mixture of the same scan, whose tables are shared
    correlation_length : m of travel per independent measurement of the position
    """

    def __init__(self, model: MeasurementModel, mixture: SweepMixture, correlation_length: float) -> None:
        vars(self).update(vars(mixture))
        self._model = model
        self.information_length = correlation_length
        self.new_session = None

    def evaluate(
        self, states: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> Evaluation:
        """See :meth:`.SweepMixture.evaluate`."""
        volts = self.in_volts(strain) + self.noise.centre
        position = self._model.log_likelihood(states, volts, used)
        return super().evaluate(states, strain, used, offset_variance)._replace(position=position)
