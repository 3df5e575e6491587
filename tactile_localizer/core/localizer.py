"""The localizer: strains and palm positions in, an estimate of the palm's position out.

Live nodes, replay and benchmarks share it.
"""

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.filters.base import BayesFilter, Prediction
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.geometry.anchors import Anchors
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.hypotheses.convergence import (
    Convergence,
    ConvergenceCriteria,
    Ellipsoid,
    State,
)
from tactile_localizer.core.hypotheses.explanations import RELOCATION_DISTANCE, Explanations
from tactile_localizer.core.likelihood.base import MeasurementModel, checked, has_finite_squares, real_numbers
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.scatter import SCATTERED
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.measurements import Measurement, Measurements
from tactile_localizer.core.sweep import Evidence, Sweep
from tactile_localizer.core.weights import bayes
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Scene


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
    log_other : the same of other material, nats
    consistent : (F,) bool, phalanges without a gauge that is stuck; ``reason`` names the gauges
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
    log_other: float
    consistent: np.ndarray
    effective_sample_size: float
    hypotheses: int
    travel: float
    updated: bool

    @property
    def converged(self) -> bool:
        """Whether the position has converged."""
        return self.state is State.CONVERGED


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
    position_model : another measurement model for the position; ``None``: ``model``
    convergence : decides when the position has converged
    measurements : makes a measurement of the strains of each update distance
    information_length : m of travel per independent measurement of the position
    explanation_length : the same of what explains the strain, and of what the sweep differs by
    registration_std : (d,) m (yaw: rad), how far the positions of one sweep are from those of another
    anchors : trajectories that represent the whole map
    """

    def __init__(
        self,
        scene: Scene,
        bayes_filter: BayesFilter,
        model: SweepMixture,
        position_model: MeasurementModel | None,
        convergence: Convergence,
        measurements: Measurements,
        information_length: float,
        explanation_length: float,
        registration_std: np.ndarray,
        anchors: Anchors,
    ) -> None:
        self.scene = scene
        self.filter = bayes_filter
        self.model = model
        self._position_model = position_model
        self._convergence = convergence
        self.measurements = measurements
        self.information_length, self.explanation_length = information_length, explanation_length
        self._registration = np.diag(registration_std**2)
        self._motion = MotionModel(scene)
        self._noise_per_metre = np.diag(self._motion.variance(1.0))
        self._anchors = anchors
        self._near = Ellipsoid(convergence.criteria.radius, self.registration_variance)
        self._belief: Belief | None = None
        self._restart()

    def __repr__(self) -> str:
        """One line: scene, axes, filter and model."""
        names = ", ".join(self.scene.axis_names)
        model = getattr(self._position_model, "name", type(self.model).__name__)
        return f"<Localizer on {self.scene.name} ({names}): {type(self.filter).__name__}, {model}>"

    def reset(self) -> None:
        """Return to a uniform belief over the scene, and forget what was felt."""
        self.filter.reset()
        self._restart()

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """Start from a Gaussian about ``mean`` (d,) with standard deviations ``std`` (d,), m (yaw: rad).

        Raises
        ------
        MeasurementError
            Not as many finite numbers as axes, or a negative deviation; the belief is untouched.
        """
        axes = self.scene.dimension
        for name, values in (("mean", mean), ("std", std)):
            numbers = real_numbers(values, name)
            if numbers.shape != (axes,) or not has_finite_squares(numbers):
                raise MeasurementError(f"{name}: expected {axes} finite numbers, got {values}")
        if (np.asarray(std) < 0.0).any():
            raise MeasurementError(f"std: expected no negative deviation, got {std}")
        self.filter.seed(np.asarray(mean, dtype=np.float64), np.asarray(std, dtype=np.float64))
        self._restart()

    def adjust(self, criteria: ConvergenceCriteria, update_distance: float) -> None:
        """Change the thresholds of convergence and the update distance; the belief stays."""
        self._convergence.criteria = criteria
        self._near = Ellipsoid(criteria.radius, self.registration_variance)
        self.measurements.update_distance = update_distance

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) behind the last estimate, for display."""
        return self.filter.hypotheses()

    def probability_near(self, place: np.ndarray, states: np.ndarray, weights: np.ndarray) -> float:
        """Probability that the hand is within the convergence radius of a place (d,).

        For a belief in states (P, d) with weights (P,), convolved with the registration error.
        """
        return self._near.probability(self._motion.displacement(place, states), weights)

    @property
    def converged(self) -> bool:
        """Whether the position has converged."""
        return self._convergence.converged

    @property
    def criteria(self) -> ConvergenceCriteria:
        """Thresholds of convergence."""
        return self._convergence.criteria

    @property
    def registration_variance(self) -> np.ndarray:
        """Variance (d,) of the positions of one sweep about those of another, m^2 (yaw: rad^2)."""
        return self._registration.diagonal()

    @property
    def spikes(self) -> dict[str, int]:
        """Number of single values far off that were left out, by the gauge's name, such as ``index_3``."""
        return self._gauge_names(self.measurements.spikes)

    @property
    def out_of_range(self) -> float:
        """Fraction of the recent strains that are outside the range of the scan."""
        return self.measurements.outside

    @property
    def explanations(self) -> Explanations:
        """Probabilities of what can explain the strain."""
        return self._explanations

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
        strain = strain.copy()  # the next one is predicted from it
        if self.measurements.goes_back(stamp_ns, position):
            self.reset()
        measurement = self.measurements.observe(stamp_ns, position, strain, here)
        if measurement is not None:
            self.measure(measurement)
        return self._estimate(stamp_ns, measurement is not None)

    def _restart(self) -> None:
        for part in (self._convergence, self._anchors, self.measurements):
            part.reset()
        anchors = len(self._anchors)
        self._sweep = Sweep.start(self.model, len(self.scene.phalanges), anchors)
        self._explanations = Explanations.start(anchors)
        self._belief = None
        self._travel = 0.0
        self._log_likelihoods = math.nan, math.nan
        self._notes, self._consistent = "", self.scene.layout.every

    def measure(self, measurement: Measurement) -> Belief:
        """The measurement update: move, follow, weigh, explain, decide.

        Returns the belief, at the mean position of the strains.
        """
        travel, used = measurement.travel, measurement.used
        update_travel = max(travel, self.measurements.update_distance)
        exponent = min(1.0, update_travel / self.explanation_length)

        prediction, explanations = self._move(measurement.displacement, travel)
        # An axis at a time: arrays with a short last axis take several times longer.
        places = np.concatenate([prediction.states.T, self._anchors.states.T], axis=1).T
        sweep = self._sweep.set_down() if measurement.set_down else self._sweep
        sweep = sweep.whitened_by(self.model, measurement.excess)
        evidence, self._sweep = sweep.evidence(
            measurement.strain, used, places, prediction.weights, update_travel, exponent
        )
        self._belief = belief = self._weigh(prediction, evidence, measurement, update_travel)
        tracked = bayes(prediction.weights, exponent * evidence.states)[1] / exponent
        at_anchors = self._anchors.far_from(belief.mean, RELOCATION_DISTANCE, evidence.anchors - tracked)
        self._explanations = explanations.update(
            update_travel, exponent * at_anchors, exponent * (evidence.other - tracked)
        )
        volume = sum(evidence.log_volume[used].tolist())
        self._log_likelihoods = tracked + volume, evidence.other + volume
        self._travel += travel
        self._decide(prediction.states, belief, measurement)
        return belief

    def _move(self, displacement: np.ndarray, travel: float) -> tuple[Prediction, Explanations]:
        """Belief and explanations after a motion; what is known of the sweep follows the states."""
        lost, before = self._anchors.move(displacement), self._explanations
        # The first prediction has one trajectory, of all states.
        weights = self.filter.weights() if self._sweep.strains else np.ones(1)
        prediction = self.filter.predict(displacement, travel, before.injected)
        explanations = before.predict(travel, prediction.left, lost)
        self._sweep = self._sweep.followed(prediction, weights, explanations.placed)
        return prediction, explanations

    def _weigh(
        self, prediction: Prediction, evidence: Evidence, measurement: Measurement, travel: float
    ) -> Belief:
        """The belief after a strain, by the model for the position if there is one."""
        model, position = self._position_model, evidence.position
        if model is not None:
            strain = measurement.strain
            if self.model.material is Material.SHEET:
                innovation, states = evidence.innovation, len(prediction.states)
                trend = prediction.weights @ (evidence.map_strain - innovation.of_map)[:states]
                strain = self.model.in_volts(strain, innovation.of_strain + innovation.turned + trend)
            position = model.log_likelihood(prediction.states, strain, measurement.used)
        return self.filter.update(min(1.0, travel / self.information_length) * position)

    def _decide(self, states: np.ndarray, belief: Belief, measurement: Measurement) -> None:
        """Whether the position has converged.

        That strains are out of the scan's range says nothing where the level of a sweep wanders.
        """
        explanations, outside, contradiction = self._explanations, measurement.outside, ""
        if outside > 0.5 and self.model.material is Material.SHEET:
            contradiction = f"{outside:.0%} of the strains are outside the range of the scan"
        near = self.probability_near(belief.mean, states, self.filter.weights())
        self._convergence.update(
            near, explanations.tracked, explanations.other, measurement.travel, contradiction
        )
        self._notes, self._consistent = self._scatter() + self._stuck_gauges(), self.scene.layout.every
        if np.count_nonzero(self.measurements.stuck):
            self._consistent = ~self.scene.layout.any(self.measurements.stuck)
        self._covariance = belief.covariance + self._registration

    def _scatter(self) -> str:
        """That the strain differs from the map by more than in the scan, to be added to a reason."""
        scatter = math.sqrt(max(self._sweep.scatter.variance.tolist()))
        if scatter < SCATTERED:
            return ""
        return f"; strain scatters {scatter:.2g} times as much as in the scan (force?)"

    def _stuck_gauges(self) -> str:
        """The gauges that stand still, to be added to a reason."""
        if not np.count_nonzero(self.measurements.stuck):
            return ""
        names = list(self._gauge_names(self.measurements.stuck))
        return f"; {', '.join(names)} {'stand' if len(names) > 1 else 'stands'} still"

    def _gauge_names(self, channels: np.ndarray) -> dict[str, int]:
        """Those of ``channels`` (C,) that are not zero, by names such as ``index_3``."""
        found = {}
        for channel in channels.nonzero()[0].tolist():
            phalanx, number = self.scene.layout.place(channel)
            found[f"{self.scene.phalanges[phalanx].name}_{number}"] = int(channels[channel])
        return found

    def _reason(self, travel: float) -> str:
        """Why the position has converged or not; before the hand moves, there is no other reason."""
        convergence = self._convergence
        if convergence.state is State.SEARCHING and travel < self.measurements.update_distance:
            return f"not converged: {1e3 * travel:.1f} mm travelled"
        return convergence.reason

    def _estimate(self, stamp_ns: int, updated: bool) -> Estimate:
        belief = self._belief
        assert belief is not None
        pending = self.measurements.pending
        travel = self._motion.travel(pending)
        covariance = self._covariance + travel * self._noise_per_metre
        convergence = self._convergence
        log_marginal, log_other = self._log_likelihoods
        return Estimate(
            stamp_ns=stamp_ns,
            mean=self._motion.wrapped(belief.mean + pending),
            covariance=covariance,
            trace=sum(covariance.ravel().tolist()[:: len(covariance) + 1]),
            state=convergence.state,
            reason=self._reason(self._travel + travel) + self._notes,
            probability=convergence.probability,
            on_map=self._explanations.on_map,
            log_marginal=log_marginal,
            log_other=log_other,
            consistent=self._consistent,
            effective_sample_size=belief.effective_sample_size,
            hypotheses=belief.hypotheses,
            travel=self._travel + travel,
            updated=updated,
        )
