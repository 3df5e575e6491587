"""The localizer: strains and palm positions in, an estimate of the palm's position out.

Live nodes, replay and benchmarks share it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.filters.base import BayesFilter, Prediction
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.geometry.references import COARSE, FINE, References, TakenIn
from tactile_localizer.core.hypotheses.convergence import (
    Convergence,
    ConvergenceCriteria,
    State,
    probability_within,
)
from tactile_localizer.core.hypotheses.correlation import AWAY, PRIOR, Correlation, Sums
from tactile_localizer.core.hypotheses.explanations import Explanations
from tactile_localizer.core.likelihood.base import MeasurementModel, checked, has_finite_squares, real_numbers
from tactile_localizer.core.likelihood.drift import Innovation, Trend
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.likelihood.weights import log_sum, probability
from tactile_localizer.core.plausibility import PhalanxConsistency, StampUnit
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Scene

UPDATE_PERIOD_NS = 8_000_000
"""Least time between two measurement updates, ns, by their stamps. A hand that moves fast, as between sweeps,
passes an update distance with every strain; an update for each would take longer than they take to come."""


class Estimate(NamedTuple):
    """The belief after a strain vector.

    Parameters
    ----------
    stamp_ns : of the strain vector
    mean, covariance : (d,) and (d, d), m (yaw: rad)
    trace : sum of the variances
    state, reason : whether the position has converged, and why or why not
    probability : that the hand is on the map and within the convergence radius of the mean
    on_map : probability that the map explains what is felt
    log_marginal : log P(z_t | z_1:t-1) at the last measurement update, on the map, nats; tempered as in the
        filter, then scaled to a whole measurement
    log_unknown, log_featureless : the same of unknown, and of featureless material off the map, nats
    consistent : (F,) bool, phalanges that are not stuck
    effective_sample_size, hypotheses : of the particles or cells
    travel : m since the belief was uniform
    updated : whether this strain led to a measurement update; otherwise the belief was only moved along
    """

    stamp_ns: int
    mean: np.ndarray
    covariance: np.ndarray
    trace: float
    state: State
    reason: str
    probability: float
    on_map: float
    log_marginal: float
    log_unknown: float
    log_featureless: float
    consistent: np.ndarray
    effective_sample_size: float
    hypotheses: int
    travel: float
    updated: bool

    @property
    def converged(self) -> bool:
        """Whether the position has converged."""
        return self.state is State.CONVERGED


class _Sweep(NamedTuple):
    """What is known of the sweep, along the P trajectories of the states and the R of the references.

    Parameters
    ----------
    weights : (P,) of the states
    trend : by which the sweep differs from the scan
    sums : of the correlation with the map along the references
    explanations : probabilities of what explains the strain
    log_odds : of the map to chance
    """

    weights: np.ndarray
    trend: Trend
    sums: Sums
    explanations: Explanations
    log_odds: float


class Localizer:
    """Feeds a Bayes filter by travelled distance and decides when its estimate has converged.

    The filter is given only displacements of the palm. There is one measurement update per
    ``update_distance`` of travel, and not more often than each :data:`UPDATE_PERIOD_NS`; a hand at rest
    learns nothing new. The first strain leads to an update.

    Parameters
    ----------
    scene : what is modelled
    bayes_filter : a particle or grid filter over that scene
    model : what a place feels like
    position_model : one of the paper's models, or a user-defined one, for the position; ``None``: ``model``
    correlation : evidence for the map where the material is felt everywhere; ``None`` elsewhere
    convergence : decides when the position has converged
    update_distance : m of travel between two measurement updates
    information_length, presence_length : m of travel per independent measurement of the position, and of the
        material
    registration_std : (d,) m (yaw: rad), how far the positions of one sweep are from those of another
    """

    def __init__(
        self,
        scene: Scene,
        bayes_filter: BayesFilter,
        model: SweepMixture,
        position_model: MeasurementModel | None,
        correlation: Correlation | None,
        convergence: Convergence,
        update_distance: float,
        information_length: float,
        presence_length: float,
        registration_std: np.ndarray,
    ) -> None:
        self.scene = scene
        self.filter = bayes_filter
        self.model = model
        self._position_model, self._correlation = position_model, correlation
        self._convergence = convergence
        self._update_distance = update_distance
        self._information_length, self._presence_length = information_length, presence_length
        self._registration = np.diag(registration_std**2)
        self._motion = MotionModel(scene)
        self._noise_per_metre = np.diag(self._motion.variance(1.0))
        self._consistency = PhalanxConsistency(scene.layout)
        self._references = References(scene, COARSE if correlation is None else FINE)
        self._stamp_unit = StampUnit()
        self._stamp_ns: int | None = None
        self._updated_ns = 0
        self._updated_at: np.ndarray | None = None
        self._belief: Belief | None = None
        self._restart()

    def reset(self) -> None:
        """Return to a uniform belief over the scene, and forget what was felt."""
        self.filter.reset()
        self._restart()

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """Start from a Gaussian about ``mean`` (d,) with standard deviations ``std`` (d,), m (yaw: rad)."""
        self.filter.seed(mean, std)
        self._restart()

    def adjust(self, criteria: ConvergenceCriteria, update_distance: float) -> None:
        """Change the thresholds of convergence and the update distance; the belief stays."""
        self._convergence.criteria = criteria
        self._update_distance = update_distance

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) behind the last estimate, for display."""
        return self.filter.hypotheses()

    @property
    def explanations(self) -> Explanations:
        """Probabilities of what can explain the strain."""
        return self._sweep.explanations

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Estimate:
        """Take in one strain vector and where the arm says the palm was.

        Parameters
        ----------
        stamp_ns : of the strain, ns; one before the last (a bag that loops) resets the belief
        position : (d,) palm in any frame that is fixed while the sweep lasts; only its differences count
        strain : (C,) V
        present : (F,) bool, phalanges to use; ``None``: all

        Raises
        ------
        MeasurementError
            A position or strain that is not finite or not of the expected shape, or a palm that travels
            while the stamps stand still; the belief is untouched.
        """
        position = real_numbers(position, "position").copy()
        if position.shape != (self.scene.dimension,) or not has_finite_squares(position):
            raise MeasurementError(
                f"position: expected {self.scene.dimension} finite numbers, got {position}"
            )
        strain, here = checked(strain, self.scene.layout, present)
        self._stamp_unit.check(stamp_ns, position)
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            self.reset()
        self._stamp_ns = stamp_ns
        if self._updated_at is not None:
            # As the crow flies: a pose that trembles about one place does not travel.
            self._pending = self._motion.displacement(self._updated_at, position)
            self._pending_travel = self._motion.travel(self._pending)
        updated = self._belief is None or (
            self._pending_travel >= self._update_distance and stamp_ns - self._updated_ns >= UPDATE_PERIOD_NS
        )
        if updated:
            self._updated_ns, self._updated_at = stamp_ns, position
            self._measure(strain, here)
        return self._estimate(stamp_ns, updated)

    def _restart(self) -> None:
        for part in (self._convergence, self._consistency, self._references):
            part.reset()
        references = len(self._references)
        # The first prediction has no ancestors: all trajectories begin at the references.
        self._sweep = _Sweep(
            weights=np.ones(1),
            trend=self.model.drift.start(1 + references),
            sums=Sums.start(references),
            explanations=Explanations.start(references, only_map=self._correlation is not None),
            log_odds=-PRIOR,
        )
        self._stamp_unit.reset()
        self._stamp_ns = None
        self._updated_ns = 0
        self._updated_at = None
        self._belief = None
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0
        self._travel = 0.0
        self._log_likelihoods = np.full(3, np.nan)

    def _measure(self, strain: np.ndarray, present: np.ndarray) -> None:
        """The measurement update: predicted belief, likelihoods, posterior, explanations, decision."""
        travel = self._pending_travel
        stretch = max(travel, self._update_distance)
        self._consistency.observe(strain, present, travel)
        used, exponent = self._used(present), min(1.0, stretch / self._information_length)

        prediction, sweep = self._predict(travel)
        places = np.concatenate([prediction.states, self._references.states])
        nodes, expected = self.model.expected(places)
        innovation, trend = self.model.innovation(
            sweep.trend, strain, places, expected, prediction.log_weights, stretch, exponent
        )
        likelihoods = self.model.evaluate(nodes, prediction.log_weights, innovation, used)
        position = likelihoods.states
        if self._position_model is not None:
            position = self._position_likelihood(prediction, innovation, strain, used)

        belief = self.filter.update(exponent * position)
        weights = self.filter.weights()
        tracked = log_sum(prediction.log_weights + exponent * likelihoods.states) / exponent
        is_elsewhere = self._motion.travels(places[len(weights) :] - belief.mean) > AWAY
        material = min(1.0, stretch / self._presence_length)
        explanations = sweep.explanations.update(tracked, likelihoods, is_elsewhere, material)
        sums, log_odds = sweep.sums, sweep.log_odds
        if self._correlation is not None:
            variance = self.model.variance(nodes[len(weights) :])
            along = innovation.map[len(weights) :]
            sums = self._correlation.update(sums, innovation.strain, along, variance, stretch)
            boxes = self._references.index(prediction.states)
            masses = np.bincount(boxes, weights, minlength=len(self._references))
            log_odds = self._correlation.log_odds(sums, masses, is_elsewhere)

        self._sweep = _Sweep(weights, trend, sums, explanations, log_odds)
        self._belief = belief
        self._log_likelihoods = np.array([tracked, likelihoods.unknown, likelihoods.featureless])
        self._travel += travel
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0
        self._decide(prediction.states, weights, belief, travel)

    def _predict(self, travel: float) -> tuple[Prediction, _Sweep]:
        """The predicted belief, and what is known of the sweep along its trajectories."""
        sweep, references = self._sweep, self._references
        references.move(self._pending)
        taken_in = None
        if sweep.explanations.taken_in:
            taken_in = TakenIn(sweep.explanations.taken_in, references, np.exp(sweep.explanations.elsewhere))
        prediction = self.filter.predict(self._pending, travel, taken_in)
        explanations = sweep.explanations.predict(travel, prediction.left)
        before = len(sweep.weights)
        if taken_in is None and np.array_equal(prediction.ancestors, np.arange(before)):
            return prediction, sweep._replace(explanations=explanations)
        # The trajectories of the references follow those of the states; new states begin from them.
        rows = before + np.arange(len(references))
        ancestors = np.concatenate([prediction.ancestors, rows])
        continued = np.concatenate([prediction.continued, np.ones(len(rows))])
        begun = np.concatenate([rows[references.index(prediction.states)], rows])
        return prediction, sweep._replace(
            trend=sweep.trend.followed(ancestors, continued, begun),
            sums=sweep.sums if taken_in is None else sweep.sums.relocated(sweep.log_odds),
            explanations=explanations,
        )

    def _position_likelihood(
        self, prediction: Prediction, innovation: Innovation, strain: np.ndarray, used: np.ndarray
    ) -> np.ndarray:
        """Log-likelihoods (P,) by the model for the position, of the strain without the sweep's offset."""
        assert self._position_model is not None
        if self.model.is_featureless:
            trend = np.exp(prediction.log_weights) @ innovation.map_trend[: len(prediction.states)]
            strain = self.model.in_volts(innovation.strain + innovation.turned + trend)
        return self._position_model.log_likelihood(prediction.states, strain, used)

    def _decide(self, states: np.ndarray, weights: np.ndarray, belief: Belief, travel: float) -> None:
        """Whether the position has converged."""
        explanations = self._sweep.explanations
        on_map, unknown = explanations.on_map, explanations.unknown
        if self._correlation is not None:
            on_map = probability(self._sweep.log_odds)
            unknown = 1.0 - on_map
        self._on_map = on_map
        away = self._motion.displacement(belief.mean, states)
        radius, registration = self._convergence.criteria.radius, self._registration.diagonal()
        near = probability_within(away, weights, radius, registration)
        tracked = on_map * explanations.tracked / max(explanations.on_map, 1e-300)
        self._convergence.update(near, tracked, unknown, travel)

    def _used(self, present: np.ndarray) -> np.ndarray:
        """Phalanges that are present and consistent; the present ones, where none is left."""
        used = present & self._consistency.consistent
        return used if used.any() else present

    def _estimate(self, stamp_ns: int, updated: bool) -> Estimate:
        belief = self._belief
        assert belief is not None
        covariance = belief.covariance + self._registration + self._pending_travel * self._noise_per_metre
        convergence = self._convergence
        log_marginal, log_unknown, log_featureless = self._log_likelihoods.tolist()
        return Estimate(
            stamp_ns=stamp_ns,
            mean=self._motion.wrapped(belief.mean + self._pending),
            covariance=covariance,
            trace=sum(covariance.ravel().tolist()[:: len(covariance) + 1]),
            state=convergence.state,
            reason=convergence.reason,
            probability=convergence.probability,
            on_map=self._on_map,
            log_marginal=log_marginal,
            log_unknown=log_unknown,
            log_featureless=log_featureless,
            consistent=self._consistency.consistent,
            effective_sample_size=belief.effective_sample_size,
            hypotheses=belief.hypotheses,
            travel=self._travel + self._pending_travel,
            updated=updated,
        )
