"""The localizer: strains and palm positions in, a believed position out.

Live nodes, replay and benchmarks share it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.bayes_filter import BayesFilter
from tactile_localizer.core.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.correlation import Correlation
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.base import checked, usable
from tactile_localizer.core.null_model import NullModel
from tactile_localizer.core.phalanx_health import PhalanxHealth
from tactile_localizer.core.recovery import Recovery
from tactile_localizer.core.sweep_offset import SweepOffset
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Scene

WEIGHING_PERIOD_NS = 8_000_000
"""Least time between two weighed strains, ns, by their stamps. A hand that moves fast, as between sweeps,
passes an update distance with every strain; weighing them all would take longer than they take to come."""
STRIDES = 2.0
"""Update distances that one strain speaks for at most: where none came, nobody knows what was passed."""


class Estimate(NamedTuple):
    """What is believed after a strain vector.

    Parameters
    ----------
    stamp_ns : of the strain vector
    mean, covariance : (d,) and (d, d), m (yaw: rad)
    trace : sum of the variances
    converged, reason : whether the position may be believed, and why or why not
    evidence : nats gathered for the believed place
    log_marginal : log P(z_t | z_1:t-1) at the last update, nats
    log_featureless, log_unknown : how well that strain is explained as one of featureless material, and of
        material that was never scanned, nats
    strain : (C,) V, that strain without the sweep's offset
    log_evidence : what that strain, tempered, adds to the evidence for the material that was scanned, nats
    weight : share of an independent measurement that this strain counted for; zero where it was not weighed
    trusted : (F,) bool, phalanges that are not stuck and do not contradict the others
    effective_sample_size, hypotheses : of the particles or cells
    travel : m since the belief was last spread over the whole scene
    updated : whether this strain was weighed; otherwise the last belief was only moved along
    """

    stamp_ns: int
    mean: np.ndarray
    covariance: np.ndarray
    trace: float
    converged: bool
    reason: str
    evidence: float
    log_marginal: float
    log_featureless: float
    log_unknown: float
    strain: np.ndarray
    log_evidence: float
    weight: float
    trusted: np.ndarray
    effective_sample_size: float
    hypotheses: int
    travel: float
    updated: bool


class Localizer:
    """Feeds a Bayes filter by travelled distance and decides when it may be believed.

    The filter is given only displacements of the palm. Consecutive strains are correlated: one is weighed
    each ``update_distance`` of travel, and not more often than each :data:`WEIGHING_PERIOD_NS`, with its
    likelihood raised to the share of an independent measurement that it makes (:class:`.Correlation`). A hand
    at rest learns nothing new. The first strain counts as one update distance.

    Parameters
    ----------
    scene : what is modelled
    bayes_filter : a particle or grid filter over that scene
    null : the position-blind explanation that evidence is measured against
    convergence : decides when the position may be believed
    recovery : spreads a contradicted belief; ``None``: never
    health : tells which phalanges to trust
    update_distance : m of travel between two weighed strains
    correlation : how much consecutive strains have in common
    offset : learns and removes the sweep's own offset; ``None``: strains are taken as they come
    """

    def __init__(
        self,
        scene: Scene,
        bayes_filter: BayesFilter,
        null: NullModel,
        convergence: Convergence,
        recovery: Recovery | None,
        health: PhalanxHealth,
        update_distance: float,
        correlation: Correlation,
        offset: SweepOffset | None = None,
    ) -> None:
        self.scene = scene
        self.filter = bayes_filter
        self._null = null
        self._convergence = convergence
        self._recovery = recovery
        self._health = health
        self._update_distance = update_distance
        self._correlation = correlation
        self._offset = offset
        self._motion = MotionModel(scene)
        self._noise_per_metre = np.diag(self._motion.variance(1.0))
        self._stamp_ns: int | None = None
        self._weighed_ns = 0
        self._last_position: np.ndarray | None = None
        self._belief: Belief | None = None
        self._strain: np.ndarray
        self._pending: np.ndarray = np.zeros(scene.dimension)
        self._pending_travel = 0.0
        self._restart()

    def reset(self) -> None:
        """Believe in every state of the scene alike, and forget all evidence."""
        self.filter.reset()
        self._restart()

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """Believe in a Gaussian about ``mean`` (d,) with standard deviations ``std`` (d,), m (yaw: rad)."""
        self.filter.seed(mean, std)
        self._restart()

    def adjust(self, criteria: ConvergenceCriteria, update_distance: float) -> None:
        """Change when the position may be believed, and how often strains are weighed; the belief stays."""
        self._convergence.criteria = criteria
        self._update_distance = update_distance

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) behind the last estimate, for display."""
        return self.filter.hypotheses()

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Estimate:
        """Take in one strain vector and where the arm says the palm was.

        Parameters
        ----------
        stamp_ns : of the strain; one before the last (a bag that loops) starts anew
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
        if self._last_position is not None:
            self._pending = self._pending + self._motion.displacement(self._last_position, position)
        self._last_position = position
        # As the crow flies: a pose that trembles about one place does not travel.
        self._pending_travel = self._motion.travel(self._pending)
        updated = self._belief is None or (
            self._pending_travel >= self._update_distance
            and stamp_ns - self._weighed_ns >= WEIGHING_PERIOD_NS
        )
        self._weight = 0.0
        if updated:
            self._weighed_ns = stamp_ns
            self._weigh(strain, here)
        return self._estimate(stamp_ns, updated)

    def _restart(self) -> None:
        if self._recovery is not None:
            self._recovery.reset()
        if self._offset is not None:
            self._offset.reset()
        self._correlation.reset()
        self._convergence.reset()
        self._health.reset()
        self._stamp_ns = None
        self._last_position = None
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0
        self._travel = 0.0
        self._belief = None
        self._log_marginal = self._log_featureless = self._log_unknown = self._log_evidence = float("nan")
        self._weight = 0.0

    def _weigh(self, strain: np.ndarray, present: np.ndarray) -> None:
        travel = self._pending_travel
        if travel > 0.0:
            self.filter.predict(self._pending, travel)
        counted = max(travel, self._update_distance)
        self._health.hear(strain, present, travel)
        used = self._used(present)
        self._weight = self._correlation.share(strain, used, counted)
        new_sweep = -math.inf
        if self._offset is not None:
            new_sweep = self._offset.log_density(strain, used)
            strain = self._offset.corrected(strain, used, counted)
        self._strain = strain
        credit = self._null.credit(strain, used)._replace(new_sweep=new_sweep)
        featureless, unknown = credit.featureless, self._null.unknown(strain, used)
        self._log_marginal, log_evidence = self.filter.update(strain, used, self._weight, credit)
        # Left out, a phalanx that contradicts the belief still speaks against it, as it has of late.
        left_out = present & ~used
        rest = self._null.log_density(strain, left_out) if left_out.any() else 0.0
        self._log_featureless, self._log_unknown = featureless + rest, unknown + rest
        self._log_evidence = log_evidence + self._weight * (rest + self._health.contradiction(left_out))
        self._belief = self.filter.belief()
        speaks = self._log_marginal - max(credit.best, unknown)
        self._convergence.update(self._belief, speaks, min(travel, STRIDES * self._update_distance))
        self._health.update(*self.filter.hypotheses(), strain, present, travel)
        if self._recovery is not None:
            fraction = self._recovery.fraction(self._log_marginal - max(featureless, unknown), counted)
            if fraction > 0.0:
                self.filter.recover(fraction)
        self._travel += travel
        self._pending = np.zeros(self.scene.dimension)
        self._pending_travel = 0.0

    def _used(self, present: np.ndarray) -> np.ndarray:
        """Phalanges that are present and trusted; the present ones, where no trusted one is left."""
        used = present & self._health.trusted
        return used if used.any() else present

    def _estimate(self, stamp_ns: int, updated: bool) -> Estimate:
        belief = self._belief
        assert belief is not None
        covariance = belief.covariance + self._pending_travel * self._noise_per_metre
        convergence = self._convergence
        return Estimate(
            stamp_ns=stamp_ns,
            mean=self._motion.wrapped(belief.mean + self._pending),
            covariance=covariance,
            trace=sum(covariance.ravel().tolist()[:: len(covariance) + 1]),
            converged=convergence.converged,
            reason=convergence.reason,
            evidence=convergence.evidence,
            log_marginal=self._log_marginal,
            log_featureless=self._log_featureless,
            log_unknown=self._log_unknown,
            strain=self._strain,
            log_evidence=self._log_evidence,
            weight=self._weight,
            trusted=self._health.trusted,
            effective_sample_size=belief.effective_sample_size,
            hypotheses=belief.hypotheses,
            travel=self._travel + self._pending_travel,
            updated=updated,
        )
