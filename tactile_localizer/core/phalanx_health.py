"""Which phalanges can be trusted.

One that is stuck, or contradicts what the belief expects of it, is left out until it is well.

A load cell that is stuck, swapped, scaled or drifting still sends plausible numbers. One that is stuck sends
the same to the last bit while another changes: a load cell that works always has noise. The others are given
away by their own evidence: at the believed place the map says what that phalanx should feel, and the null
model says how well its strain is explained without the map.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.core.filters.resampling import evenly
from tactile_localizer.core.filters.weights import log_mean
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.null_model import NullModel
from tactile_localizer.scene import Scene

_STATES = 48
"""States drawn evenly from the belief to ask what a phalanx should feel."""


class PhalanxHealth:
    """Averages each phalanx's log-ratio of belief to null over the travel and decides which to use.

    Parameters
    ----------
    scene, model, null : as the localizer's

    Attributes
    ----------
    trusted : (F,) bool, phalanges to use; replaced, never changed in place
    """

    _STUCK = 0.002
    """m of travel over which a phalanx that says the same is taken for stuck."""

    _INTERVAL = 0.002
    """m of travel between two checks: they cost as much as an update."""
    _MEMORY = 0.003
    """m of travel over which log-ratios are averaged."""
    _SICK = -6.0
    _WELL = -1.5
    """Average log-ratio, nats, below which a phalanx is left out, and above which it is taken back."""

    def __init__(self, scene: Scene, model: MeasurementModel, null: NullModel) -> None:
        self._scene, self._model, self._null = scene, model, null
        self.reset()

    def reset(self) -> None:
        """Trust every phalanx."""
        self._agree = self.trusted = np.ones(len(self._scene.phalanges), dtype=bool)
        self._average = np.zeros(len(self.trusted))
        self._pending = 0.0
        self._last: np.ndarray | None = None
        self._unchanged = np.zeros(len(self.trusted))

    def hear(self, strain: np.ndarray, present: np.ndarray, travel: float) -> None:
        """Take in what the load cells say, as they say it; arguments as :meth:`update`."""
        if self._last is not None:
            same = present & self._scene.layout.all(strain == self._last)
            others_change = (present & ~same).any()
            self._unchanged = np.where(same, self._unchanged + travel * others_change, 0.0)
            self.trusted = self._agree & (self._unchanged < self._STUCK)
        self._last = strain.copy()

    def contradiction(self, phalanges: np.ndarray) -> float:
        """Log-ratio of belief to null, nats, of those ``phalanges`` (F,) that contradict the belief."""
        return float(self._average[phalanges & ~self._agree].sum())

    def update(
        self, states: np.ndarray, weights: np.ndarray, strain: np.ndarray, present: np.ndarray, travel: float
    ) -> None:
        """Take in what the phalanges felt where the belief was.

        Parameters
        ----------
        states, weights : (P, d) and (P,), the belief
        strain, present : (C,) V and (F,) bool
        travel : m since the last call
        """
        self._pending += travel
        if self._pending < self._INTERVAL or len(self.trusted) < 2:
            return
        gain = -math.expm1(-self._pending / self._MEMORY)
        self._pending = 0.0
        drawn = states[evenly(weights, _STATES)]
        on_feature = self._scene.phalanges_on_feature(drawn)
        for index in np.flatnonzero(present):
            alone = np.arange(len(self.trusted)) == index
            log_ratio = self._log_ratio(drawn, on_feature[:, index], strain, alone)
            self._average[index] += gain * (min(max(log_ratio, -20.0), 20.0) - self._average[index])
        self._decide()

    def _log_ratio(
        self, states: np.ndarray, on_feature: np.ndarray, strain: np.ndarray, alone: np.ndarray
    ) -> float:
        """How much better the believed places explain one phalanx's strain than the null does, nats."""
        credit = self._null.credit(strain, alone)
        by_belief = credit.earned(self._model.log_likelihood(states, strain, alone), ~on_feature)
        by_null = max(credit.featureless, self._null.unknown(strain, alone))
        return log_mean(by_belief) - by_null

    def _decide(self) -> None:
        """Leave out the worst phalanx that contradicts, if another does not; take back the well ones."""
        agree = self._agree | (self._average > self._WELL)
        suspects = agree & (self._average < self._SICK)
        if suspects.any() and (agree & (self._average > self._SICK)).any():
            agree[int(np.argmin(np.where(suspects, self._average, np.inf)))] = False
        self._agree = agree
        self.trusted = agree & (self._unchanged < self._STUCK)
