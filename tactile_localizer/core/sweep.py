"""What is known of a sweep along the trajectories of a belief, and the evidence of its next strain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.filters.base import Prediction
from tactile_localizer.core.likelihood.ancestry import Ancestry
from tactile_localizer.core.likelihood.drift import Innovation, Trend
from tactile_localizer.core.likelihood.gain import RECENT, Gain
from tactile_localizer.core.likelihood.on_map import Places
from tactile_localizer.core.likelihood.scatter import Scatter
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.weights import bayes


class Evidence(NamedTuple):
    """Log-likelihoods of a strain.

    Parameters
    ----------
    states, anchors : (P,) and (R,) at places of the map, under the noise that it shares with other material
    position : (P,) at the states, under the covariance of the sweep at hand
    other : of other material
    log_volume : (F,) logarithms of the volumes of the strains, for all but the position's
    innovation : of the strain, and of the map at states and anchors
    map_strain : (P + R, C) there, whitened
    """

    states: np.ndarray
    anchors: np.ndarray
    position: np.ndarray
    other: float
    log_volume: np.ndarray
    innovation: Innovation
    map_strain: np.ndarray


class Sweep(NamedTuple):
    """What is known of a sweep along each trajectory: those of the P states, then those of the R anchors.

    Parameters
    ----------
    model : measurement model for the noise of the sweep
    trend : by which the sweep differs from the scan
    gain : factor of its signal
    scatter : of its residuals about the map
    strength_weights : (G, F) of the strengths of other material
    strains : number of strains taken in
    """

    model: SweepMixture
    trend: Trend
    gain: Gain
    scatter: Scatter
    strength_weights: np.ndarray
    strains: int = 0

    @classmethod
    def start(cls, model: SweepMixture, phalanges: int, anchors: int) -> Sweep:
        """Before the first strain: a trajectory of all states, and those of the anchors."""
        return cls(
            model,
            model.drift.start(1 + anchors),
            Gain.start(phalanges, 1 + anchors, model.gain_variance),
            Scatter.start(model.noise.layout),
            model.other.start(),
        )

    def followed(self, prediction: Prediction, weights: np.ndarray, placed: np.ndarray) -> Sweep:
        """Along the trajectories to predicted states, and those of the anchors, which continue themselves.

        ``weights`` (P,) are of the states before, and ``placed`` (R,) is the fraction of the weight of each
        anchor that was placed there, from anywhere.
        """
        ancestry = Ancestry(prediction.ancestors, prediction.continued, placed, weights)
        # Without keywords, which take several times longer.
        return Sweep(self.model, self.trend.followed(ancestry), self.gain.followed(ancestry), *self[3:])

    def set_down(self) -> Sweep:
        """The sweep after the hand was lifted and set down again, which makes another level."""
        return self._replace(trend=self.model.drift.start(self.trend.of_map.shape[1]))

    def whitened_by(self, model: SweepMixture, excess: np.ndarray) -> Sweep:
        """With the ``model`` of the scan for strains that have more noise, by ``excess`` (C, C), V^2.

        It stays where no channel's noise has changed by a fifth.
        """
        if not self.model.is_changed(excess):
            return self
        noisier = model.with_noise(excess)
        return self._replace(model=noisier, scatter=self.scatter.moved(noisier.whitening_after(self.model)))

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
        does not predict. What scatters along the strain itself, as under a force that varies, is noise on the
        map and off it. What scatters in other directions is noise for the position alone: whether this is the
        map at all has to be judged by the scan.

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
        measured = None if np.count_nonzero(used) == len(used) else model.noise.layout.expand(used)
        innovation, trend = model.innovation(
            self.trend, strain, places, map_strain, weights, travel, exponent, measured
        )
        gain = self.gain.predicted(travel, model.gain_variance)
        there, felt = Places(nodes, states, innovation.of_map, gain), model.felt(innovation, used)
        forced, scattered = self._under_its_conditions(strain)
        by_force = felt if forced is model else forced.felt(innovation, used)
        on_map = in_sweep = forced.on_map(by_force, there, exponent)
        if scattered is not forced:
            in_sweep = scattered.on_map(scattered.felt(innovation, used), there, exponent)
        off_map, level_variance = forced.off_map(innovation)
        other, strength_weights = forced.other.update(
            self.strength_weights, off_map, level_variance, used, travel, exponent
        )
        # Weighted as a whole measurement: a belief that is still open also holds places that misfit.
        moments = model.moments(felt, there, bayes(weights, in_sweep.states)[0])
        share = max(min(1.0, travel / RECENT), 1.0 / (1 + self.strains))
        # The first strains count as independent: a direction too many makes the position late, not wrong.
        measurements = min(exponent * RECENT / travel, 1.0 / share)
        after = Sweep(
            model,
            trend,
            in_sweep.gain,
            self.scatter.after(moments, used, share, measurements),
            strength_weights,
            self.strains + 1,
        )
        found = Evidence(
            on_map.states,
            on_map.anchors,
            in_sweep.states,
            other,
            forced.log_volume,
            innovation,
            map_strain,
        )
        return found, after

    def _under_its_conditions(self, strain: np.ndarray) -> tuple[SweepMixture, SweepMixture]:
        """The models for whether this is the map, and for the position, by how strains scatter so far."""
        model = self.model
        if self.scatter.is_usual:
            return model, model
        force = self.scatter.along(model.direction(strain))
        forced = model if force is None else model.with_whitening(force)
        whitening = self.scatter.whitening(force)
        if whitening is None or whitening is force:
            return forced, forced
        return forced, model.with_whitening(whitening)
