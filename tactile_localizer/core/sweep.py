"""What is known of a sweep along the trajectories of a belief, and the evidence of its next strain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.filters.base import Prediction
from tactile_localizer.core.likelihood.drift import OUTLIER, Innovation, Trend
from tactile_localizer.core.likelihood.gain import RECENT, Gain
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.weights import bayes

_CHANGED = 0.2
"""Relative change of the noise of a channel from which strains are whitened anew."""


class Evidence(NamedTuple):
    """Log-likelihoods of a strain.

    Parameters
    ----------
    states, anchors : (P,) and (R,) at places of the map, under the variance of a visit in the scan
    position : (P,) at the states, under the variance of the sweep at hand
    other : of other material
    innovation : of the strain, and of the map at states and anchors
    map_strain : (P + R, C) there, whitened
    """

    states: np.ndarray
    anchors: np.ndarray
    position: np.ndarray
    other: float
    innovation: Innovation
    map_strain: np.ndarray


class Sweep(NamedTuple):
    """What is known of a sweep along each trajectory: those of the P states, then those of the R anchors.

    Parameters
    ----------
    model : measurement model for the noise of the sweep
    trend : by which the sweep differs from the scan
    gain : factor of its signal
    scale : (F,) mean of its squared residuals, in those of the scan
    strength_weights : (G, F) of the strengths of other material
    strains : number of strains taken in
    """

    model: SweepMixture
    trend: Trend
    gain: Gain
    scale: np.ndarray
    strength_weights: np.ndarray
    strains: int = 0

    @classmethod
    def start(cls, model: SweepMixture, phalanges: int, anchors: int) -> Sweep:
        """Before the first strain: a trajectory of all states, and those of the anchors."""
        return cls(
            model,
            model.drift.start(1 + anchors),
            Gain.start(phalanges, 1 + anchors, model.gain_variance),
            np.ones(phalanges),
            model.other.start(),
        )

    def followed(self, prediction: Prediction, weights: np.ndarray) -> Sweep:
        """Along the trajectories to predicted states; ``weights`` (P,) are of the states before.

        What of a state's weight was taken in, from anywhere, has the mean over all states before: a hand that
        was placed elsewhere was tracked.
        """
        before, new = len(weights), (prediction.continued < 1.0).nonzero()[0]
        own = len(prediction.ancestors) == before and prediction.ancestors == np.arange(before)
        if not len(new) and np.all(own):
            return self
        # The trajectories of the anchors follow those of the states.
        anchors = np.arange(before, self.trend.of_map.shape[1])
        ancestors = np.concatenate([prediction.ancestors, anchors])
        trend, gain = self.trend.followed(ancestors), self.gain.followed(ancestors)
        if len(new):
            fraction = 1.0 - prediction.continued[new]
            trend.mix(new, self.trend.averaged(weights), fraction)
            gain.mix(new, self.gain.averaged(weights), fraction)
        return self._replace(trend=trend, gain=gain)

    def whitened_by(self, model: SweepMixture, excess: np.ndarray) -> Sweep:
        """With the ``model`` of the scan for strains that have more noise, by ``excess`` (C,) V^2.

        It stays where no channel's noise has changed by a fifth.
        """
        changed = np.abs(excess - self.model.excess) > _CHANGED * (model.noise.variance + self.model.excess)
        return self._replace(model=model.with_noise(excess)) if np.count_nonzero(changed) else self

    def evidence(
        self,
        strain: np.ndarray,
        used: np.ndarray,
        places: np.ndarray,
        weights: np.ndarray,
        travel: float,
        exponent: float,
    ) -> tuple[Evidence, Sweep]:
        """The evidence of a strain, and what is known of the sweep after it.

        Compared with the map is the strain, whitened, and of it the innovation, which the trend of the sweep
        does not predict.

        Parameters
        ----------
        strain : (C,) V
        used : (F,) bool, phalanges that count
        places : (P + R, d), states and anchors
        weights : (P,) of the states
        travel : m since the last strain
        exponent : fraction of an independent measurement that the strain is
        """
        model, states = self.model, len(weights)
        nodes, map_strain = model.map_at(places)
        innovation, trend = model.innovation(
            self.trend, strain, places, map_strain, weights, travel, exponent
        )
        gain = self.gain.predicted(travel, model.gain_variance)
        on_map = model.on_map(nodes, states, innovation, gain, self.scale, used)
        off_map, level_variance = model.off_map(innovation)
        other, strength_weights = model.other.update(
            self.strength_weights, off_map, level_variance, used, travel, exponent
        )
        # Weighted as a whole measurement: a belief that is still open also holds places that misfit.
        fitting = bayes(weights, on_map.position)[0]
        squared = np.minimum(on_map.squared @ fitting, OUTLIER)
        share = max(min(1.0, travel / RECENT), 1.0 / (1 + self.strains))
        after = Sweep(
            model,
            trend,
            gain.updated(on_map.information, on_map.product, exponent),
            self.scale + share * (squared - self.scale),
            strength_weights,
            self.strains + 1,
        )
        found = Evidence(on_map.states, on_map.anchors, on_map.position, other, innovation, map_strain)
        return found, after
