"""The localizer: strains and palm positions in, an estimate of the palm's position out.

Live nodes, replay and benchmarks share it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.decision.convergence import Convergence, ConvergenceCriteria, State
from tactile_localizer.core.decision.phalanx_consistency import PhalanxConsistency
from tactile_localizer.core.decision.presence import Presence
from tactile_localizer.core.decision.relocation import Relocation
from tactile_localizer.core.decision.sweep_offset import SweepOffset
from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.base import checked, usable
from tactile_localizer.core.likelihood.new_session import unknown
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.likelihood.weights import log_sum
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
    log_elsewhere, log_featureless : the same of unknown, and of featureless material off the map, nats
    exponent : of that update in the probability of the map; zero where there was none
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
    log_elsewhere: float
    log_featureless: float
    exponent: float
    consistent: np.ndarray
    effective_sample_size: float
    hypotheses: int
    travel: float
    updated: bool

    @property
    def converged(self) -> bool:
        """Whether the position has converged."""
        return self.state is State.CONVERGED


class Coasting(NamedTuple):
    """Estimates of n strains that lead to no measurement update: what changes between two updates.

    Parameters
    ----------
    mean, covariance : (n, d) and (n, d, d), m (yaw: rad)
    travel : (n,) m since the belief was uniform
    """

    mean: np.ndarray
    covariance: np.ndarray
    travel: np.ndarray


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
    convergence : decides when the position has converged
    update_distance : m of travel between two measurement updates
    registration_std : (d,) m (yaw: rad), how far the positions of one sweep are from those of another

    Attributes
    ----------
    left : fraction of the belief that left the scene before the last measurement update
    """

    def __init__(
        self,
        scene: Scene,
        bayes_filter: BayesFilter,
        model: SweepMixture,
        convergence: Convergence,
        update_distance: float,
        registration_std: np.ndarray,
    ) -> None:
        self.scene = scene
        self.filter = bayes_filter
        self.model = model
        self._convergence = convergence
        self._update_distance = update_distance
        self._registration = np.diag(registration_std**2)
        self._motion = MotionModel(scene)
        self._noise_per_metre = np.diag(self._motion.variance(1.0))
        self._session = model.new_session
        self._presence = Presence()
        self._relocation = Relocation()
        self._offset = SweepOffset(scene.layout, model.offset_variance)
        self._consistency = PhalanxConsistency(scene.layout)
        self._stamp_ns: int | None = None
        self._updated_ns = 0
        self._updated_at: np.ndarray | None = None
        self._belief: Belief | None = None
        self._pending = np.zeros(scene.dimension)
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

    def explanations(self) -> tuple[float, float, float]:
        """Probabilities of the map, of unknown material and of featureless material off the map."""
        return self._presence.probability, self._presence.unknown, self._presence.featureless

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Estimate:
        """Take in one strain vector and where the arm says the palm was.

        Parameters
        ----------
        stamp_ns : of the strain; one before the last (a bag that loops) resets the belief
        position : (d,) palm in any frame that is fixed while the sweep lasts; only its differences count
        strain : (C,) V
        present : (F,) bool, phalanges to use; ``None``: all

        Raises
        ------
        MeasurementError
            A position or strain that is not finite or not of the expected shape; the belief is untouched.
        """
        position = np.array(position, dtype=np.float64)
        if position.shape != (self.scene.dimension,) or not usable(position):
            raise MeasurementError(
                f"position: expected {self.scene.dimension} finite numbers, got {position}"
            )
        strain, here = checked(strain, self.scene.layout, present)
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

    def coast(self, stamp_ns: np.ndarray, positions: np.ndarray) -> Coasting:
        """As :meth:`update` with one valid strain after another, as far as none leads to an update.

        Where a hand moves slowly that is most of them, and all at once they cost next to nothing.

        Parameters
        ----------
        stamp_ns : (m,) of the strains that follow the last one
        positions : (m, d) finite positions of the palm at these stamps

        Returns
        -------
        Coasting
            Of the first n of the m strains; the next one must go to :meth:`update`.
        """
        belief, origin = self._belief, self._updated_at
        if belief is None or origin is None or self._stamp_ns is None:
            return Coasting(positions[:0], np.empty((0, *positions.shape[1:] * 2)), np.empty(0))
        pending = self._motion.displacement(origin, positions)
        travel = self._motion.travels(pending)
        stops = (travel >= self._update_distance) & (stamp_ns - self._updated_ns >= UPDATE_PERIOD_NS)
        stops[:1] |= stamp_ns[:1] < self._stamp_ns
        stops[1:] |= stamp_ns[1:] < stamp_ns[:-1]
        count = int(stops.argmax()) if stops.any() else len(stops)
        if count:
            self._stamp_ns = int(stamp_ns[count - 1])
        travel = travel[:count]
        covariance = belief.covariance + self._registration + travel[:, None, None] * self._noise_per_metre
        mean = self._motion.wrapped(belief.mean + pending[:count])
        return Coasting(mean, covariance, self._travel + travel)

    def _restart(self) -> None:
        for part in (
            self._convergence,
            self._presence,
            self._relocation,
            self._offset,
            self._consistency,
        ):
            part.reset()
        if self._session is not None:
            self._session.reset()
        self._stamp_ns = None
        self._updated_at = None
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0
        self._travel = 0.0
        self._belief = None
        self._explanations = np.full(3, np.nan)
        self._exponent = 0.0
        self.left = 0.0

    def _measure(self, strain: np.ndarray, present: np.ndarray) -> None:
        """The measurement update: predicted belief, likelihoods, posterior, decision."""
        travel = self._pending_travel
        stretch = max(travel, self._update_distance)
        self.left = self.filter.predict(self._pending, travel) if travel > 0.0 else 0.0
        self._presence.predict(travel, self.left)
        injected = self._relocation.predict(travel, self._presence.probability)
        self.filter.inject(injected)

        self._consistency.observe(strain, present, travel)
        used = self._used(present)
        states, log_prior = self.filter.prior()
        whitened = self.model.whitened(strain) - self._offset.mean
        evaluation = self.model.evaluate(states, whitened, used, self._offset.phalanx_variance())

        exponent = min(1.0, stretch / self.model.information_length)
        log_unknown = unknown(log_prior, evaluation.other_material, evaluation.elsewhere)
        session = self._session
        if session is not None:
            session.returned(injected)
        if session is not None and session.is_possible:
            exponents = exponent, min(1.0, stretch / session.length)
            ratios = session.evaluate(
                self.filter.ancestors(), log_prior, evaluation, whitened, used, exponents, travel
            )
            log_ratio = log_sum(log_prior + ratios)
            self.filter.update(ratios)
        else:
            log_ratio = log_sum(log_prior + exponent * (evaluation.same_material - log_unknown))
            self.filter.update(exponent * evaluation.position)
        self._belief = self.filter.belief()

        self._decide(log_ratio / exponent, log_unknown, evaluation.featureless, travel, stretch)
        if self._offset.is_learned:
            expected = self.model.expected(
                evaluation.nodes, log_prior + exponent * evaluation.position, whitened
            )
            self._offset.update(expected, used, exponent)
        self._travel += travel
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0

    def _used(self, present: np.ndarray) -> np.ndarray:
        """Phalanges that are present and consistent; the present ones, where none is left."""
        used = present & self._consistency.consistent
        return used if used.any() else present

    def _decide(
        self, log_ratio: float, log_unknown: float, featureless: float, travel: float, stretch: float
    ) -> None:
        """Whether the map explains the strain, and whether the position has converged.

        ``log_ratio`` is that of the map to unknown material for a whole measurement, from likelihoods that
        were tempered as in the filter: a belief that follows what is felt pays for each time it moves on.
        """
        self._exponent = min(1.0, stretch / self.model.presence_length)
        self._explanations = np.array([log_unknown + log_ratio, log_unknown, featureless])
        evidence = self._exponent * self._explanations
        if featureless == -np.inf and self._travel < self.model.presence_length:
            # Felt at once, the first measurement places the hand; the next can tell whether it fits.
            evidence[0] = evidence[1]
        self._presence.update(evidence)
        self._relocation.update(float(evidence[0] - evidence[1]))
        assert self._belief is not None
        near = self.filter.mass_near(self._belief.mean, self._convergence.criteria.radius)
        self._convergence.update(near, self._presence.probability, self._presence.unknown, travel)

    def _estimate(self, stamp_ns: int, updated: bool) -> Estimate:
        belief = self._belief
        assert belief is not None
        covariance = belief.covariance + self._registration + self._pending_travel * self._noise_per_metre
        convergence = self._convergence
        log_marginal, log_elsewhere, log_featureless = self._explanations.tolist()
        return Estimate(
            stamp_ns=stamp_ns,
            mean=self._motion.wrapped(belief.mean + self._pending),
            covariance=covariance,
            trace=sum(covariance.ravel().tolist()[:: len(covariance) + 1]),
            state=convergence.state,
            reason=convergence.reason,
            probability=convergence.probability,
            on_map=self._presence.probability,
            log_marginal=log_marginal,
            log_elsewhere=log_elsewhere,
            log_featureless=log_featureless,
            exponent=self._exponent if updated else 0.0,
            consistent=self._consistency.consistent,
            effective_sample_size=belief.effective_sample_size,
            hypotheses=belief.hypotheses,
            travel=self._travel + self._pending_travel,
            updated=updated,
        )
