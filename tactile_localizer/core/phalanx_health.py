"""Which phalanges can be trusted.

One that contradicts what the belief expects of it is left out until it is well.

A load cell that is stuck, swapped, scaled or drifting still sends plausible numbers. Its own evidence gives
it away: at the believed place the map says what that phalanx should feel, and the null model says how well
its strain is explained without the map.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.core.measurement import MeasurementModel
from tactile_localizer.core.null_model import NullModel
from tactile_localizer.core.resampling import systematic
from tactile_localizer.core.weights import normalize
from tactile_localizer.scene import Scene

_STATES = 48
"""States drawn evenly from the belief to ask what a phalanx should feel."""


class PhalanxHealth:
    """Averages each phalanx's log-ratio of belief to null over the travel and decides which to use.

    Parameters
    ----------
    scene, model, null : as the localizer's
    """

    _INTERVAL = 0.002
    """m of travel between two checks: they cost as much as an update."""
    _MEMORY = 0.003
    """m of travel over which log-ratios are averaged."""
    _SICK = -6.0
    _WELL = -1.5
    """Average log-ratio, nats, below which a phalanx is left out, and above which it is taken back."""

    def __init__(self, scene: Scene, model: MeasurementModel, null: NullModel) -> None:
        self._scene, self._model, self._null = scene, model, null
        self._constant = np.random.default_rng(0)
        self.reset()

    def reset(self) -> None:
        """Trust every phalanx."""
        self.trusted = np.ones(len(self._scene.phalanges), dtype=bool)
        self._average = np.zeros(len(self.trusted))
        self._pending = 0.0

    def update(
        self, states: np.ndarray, weights: np.ndarray, strain: np.ndarray, present: np.ndarray, travel: float
    ) -> None:
        """Take in what the phalanges felt where the belief was.

        Parameters
        ----------
        states, weights : (P, d) and (P,), the belief
        strain, present : (8F,) V and (F,) bool
        travel : m since the last call
        """
        self._pending += travel
        if self._pending < self._INTERVAL or len(self.trusted) < 2:
            return
        gain = -math.expm1(-self._pending / self._MEMORY)
        self._pending = 0.0
        drawn = states[systematic(weights, _STATES, self._constant)]
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
        featureless = self._null.featureless(strain, alone)
        expected = np.where(on_feature, -np.inf, featureless)
        by_belief = np.maximum(self._model.log_likelihood(states, strain, alone), expected)
        by_null = max(featureless, self._null.unknown(strain, alone))
        return normalize(by_belief)[1] - math.log(len(states)) - by_null

    def _decide(self) -> None:
        """Leave out the worst phalanx that contradicts, if another does not; take back the well ones."""
        trusted = self.trusted | (self._average > self._WELL)
        suspects = trusted & (self._average < self._SICK)
        if suspects.any() and (trusted & (self._average > self._SICK)).any():
            trusted[int(np.argmin(np.where(suspects, self._average, np.inf)))] = False
        self.trusted = trusted
