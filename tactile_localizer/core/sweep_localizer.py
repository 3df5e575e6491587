"""Localizer of the sweep mixture: a forward filter over {on the map at x, elsewhere}."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

from tactile_localizer.core.convergence import ConvergenceCriteria as KernelCriteria
from tactile_localizer.core.decision.convergence import Convergence, mass_near
from tactile_localizer.core.decision.phalanx_consistency import PhalanxConsistency
from tactile_localizer.core.decision.presence import Presence
from tactile_localizer.core.decision.sweep_offset import SweepOffset
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.evaluation import Evaluation
from tactile_localizer.core.likelihood.slow_residual import SlowResidual
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.scene import Scene

_SWITCHING_RATE = 20.0
"""Times per metre of travel that a place comes to feel like another pair of sweeps: the deformation of the
material changes. By judgement; 5 to 100 differ by less than 3 % on
three simulated features."""
_EQUAL_SHARES = math.log(0.5)
"""Of the strains of unknown material, half are like those of the map's places, half like the estimated
place's, both with a larger variance."""


class SweepLocalizer(Localizer):
    """Feeds a grid filter by travelled distance with the likelihoods of the sweep mixture.

    Its :class:`.Estimate` has the log-odds of being on the map as ``evidence``, and the log-likelihood of
    unknown material as ``log_unknown`` and ``log_featureless``.

    Parameters
    ----------
    scene : what is modelled
    grid : filter over that scene
    model : what a place feels like
    slow_residual : how residuals go on along the travel
    decision : whether the position has converged
    update_distance : m of travel between two measurement updates
    registration_std : (d,) m (yaw: rad), how far the positions of one sweep are from those of another
    """

    def __init__(
        self,
        scene: Scene,
        grid: GridFilter,
        model: SweepMixture,
        slow_residual: SlowResidual,
        decision: Convergence,
        update_distance: float,
        registration_std: np.ndarray,
    ) -> None:
        self.scene = scene
        self.model = model
        self._grid = grid
        self._slow_residual = slow_residual
        self._decision = decision
        self._update_distance = update_distance
        self._registration = np.diag(registration_std**2)
        self._motion = MotionModel(scene)
        self._noise_per_metre = np.diag(self._motion.variance(1.0))
        self._presence = Presence()
        self._sweep_offset = SweepOffset(scene.layout, model.offset_variance)
        self._consistency = PhalanxConsistency(scene.layout)
        self._weighed_ns = 0
        self._restart()

    def reset(self) -> None:
        """See :meth:`.Localizer.reset`."""
        self._grid.reset()
        self._restart()

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """See :meth:`.Localizer.seed`."""
        self._grid.seed(mean, std)
        self._restart()

    def adjust(self, criteria: KernelCriteria, update_distance: float) -> None:
        """Change the update distance; the thresholds are probabilities and the same for all materials."""
        del criteria
        self._update_distance = update_distance

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.Localizer.hypotheses`."""
        return self._grid.hypotheses()

    def _restart(self) -> None:
        for part in (
            self._slow_residual,
            self._decision,
            self._presence,
            self._sweep_offset,
            self._consistency,
        ):
            part.reset()
        self._stamp_ns = None
        self._last_position = None
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0
        self._travel = 0.0
        self._belief = None
        self._log_marginal = self._log_elsewhere = float("nan")
        self._weight = self._exponent = 0.0

    def _weigh(self, strain: np.ndarray, present: np.ndarray) -> None:
        """The measurement update: predicted belief, likelihoods, posterior, decision."""
        travel = self._pending_travel
        left = self._grid.predict(self._pending, travel) if travel > 0.0 else 0.0
        self._grid.inject(self._presence.predict(travel, left))

        self._consistency.observe(strain, present, travel)
        used = present & self._consistency.consistent
        used = used if used.any() else present
        predicted = self._grid.prior()
        evaluation = self.model.evaluate(
            predicted.states,
            predicted.memory,
            self.model.whitened(strain) - self._sweep_offset.mean,
            used,
            self._slow_residual.step(travel),
            self._sweep_offset.phalanx_variance(),
        )
        switching = 1.0 if self._belief is None else -math.expm1(-_SWITCHING_RATE * travel)
        log_prior = self._grid.switch(evaluation.log_prior, switching)

        stretch = max(travel, self._update_distance)
        self._weight = min(1.0, stretch / self.model.information_length)
        log_likelihood = self._weight * evaluation.position
        self._grid.update(log_likelihood, evaluation.memory)
        self._belief = self._grid.belief()
        self._strain = strain - self.model.in_volts(self._sweep_offset.mean)

        self._learn_offset(log_prior + log_likelihood, evaluation, used, self._weight)
        self._decide(log_prior, evaluation, used, travel, stretch)
        self._travel += travel
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0

    def _learn_offset(
        self, log_posterior: np.ndarray, evaluation: Evaluation, used: np.ndarray, exponent: float
    ) -> None:
        weights = np.exp(log_posterior - log_posterior.max()).ravel()
        weights /= weights.sum()
        residuals = evaluation.residual.reshape(len(weights), -1)
        kept = weights > 1e-6
        weights, residuals = weights[kept], residuals[kept]
        mean = weights @ residuals
        spread = np.maximum(weights @ residuals**2 - mean**2, 0.0)
        variance = evaluation.variance.reshape(-1, evaluation.variance.shape[-1])[kept]
        noise = np.maximum(weights @ variance - self._sweep_offset.phalanx_variance(), 1e-12)
        self._sweep_offset.update(mean, spread, noise, used, exponent)

    def _decide(
        self,
        log_prior: np.ndarray,
        evaluation: Evaluation,
        used: np.ndarray,
        travel: float,
        stretch: float,
    ) -> None:
        """Whether the map applies, and whether the position has converged."""
        exponent = min(1.0, stretch / self.model.presence_length)
        here = float(logsumexp(log_prior + evaluation.marginal[..., used].sum(axis=-1)))
        same_place = float(logsumexp(log_prior + evaluation.inflated[..., used].sum(axis=-1)))
        elsewhere = float(np.logaddexp(evaluation.elsewhere, same_place)) + _EQUAL_SHARES
        self._presence.update(exponent * (here - elsewhere))
        self._log_marginal, self._log_elsewhere = here, elsewhere
        self._exponent = exponent
        assert self._belief is not None
        states, weights = self._grid.hypotheses()
        radius = self._decision.criteria.radius
        near = mass_near(states, weights, self._belief.mean, radius, self.scene.wraps)
        self._decision.update(near, self._presence.probability, travel)

    def _estimate(self, stamp_ns: int, updated: bool) -> Estimate:
        belief = self._belief
        assert belief is not None
        covariance = belief.covariance + self._registration + self._pending_travel * self._noise_per_metre
        return Estimate(
            stamp_ns=stamp_ns,
            mean=self._motion.wrapped(belief.mean + self._pending),
            covariance=covariance,
            trace=float(np.trace(covariance)),
            converged=self._decision.converged,
            reason=self._decision.reason,
            evidence=self._presence.log_odds,
            log_marginal=self._log_marginal,
            log_featureless=self._log_elsewhere,
            log_unknown=self._log_elsewhere,
            strain=self._strain,
            log_evidence=self._exponent * self._log_marginal,
            weight=self._weight,
            trusted=self._consistency.consistent,
            effective_sample_size=belief.effective_sample_size,
            hypotheses=belief.hypotheses,
            travel=self._travel + self._pending_travel,
            updated=updated,
        )
