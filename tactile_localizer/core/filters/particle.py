"""Particle filter: sampling importance resampling (paper, III-A and its reference [7])."""

import math

import numpy as np

from tactile_localizer.core.filters.base import Prediction
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.filters.resampling import systematic
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.weights import bayes, effective_sample_size, moments
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Region, Scene


class ParticleFilter:
    """Weighted particles, resampled before they are moved, so that copies get process noise of their own.

    Parameters
    ----------
    scene : bounds and motion noise; outside the bounds the weight is zero
    rng : the only source of randomness
    particles : how many; the paper uses 75
    resample_below : fraction of the particles; resample when the effective sample size is lower; 1: always
    random_particles : replace this many by uniformly random ones at each update, as the paper does (10)

    Raises
    ------
    ParameterError
        As many random particles as there are particles, or more.
    """

    def __init__(
        self,
        scene: Scene,
        rng: np.random.Generator,
        particles: int = 75,
        resample_below: float = 0.5,
        random_particles: int = 0,
    ) -> None:
        if not 0 <= random_particles < particles:
            raise ParameterError(f"random_particles: expected 0 to {particles - 1}, got {random_particles}")
        self._motion = MotionModel(scene)
        self._rng = rng
        self._count = particles
        self._resample_below = resample_below
        self._random = random_particles
        self._lower, self._upper, self._wraps = scene.lower, scene.upper, scene.wraps
        unbounded = np.where(self._wraps, math.inf, 0.0)
        self._bounds = Region(tuple(self._lower - unbounded), tuple(self._upper + unbounded))
        self._states: np.ndarray
        self._weights: np.ndarray
        self._ancestors: np.ndarray
        self.reset()

    def reset(self) -> None:
        """See :meth:`.BayesFilter.reset`; stratified over the scene, so that few particles cover it."""
        self._place(self._spread(self._count))

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """See :meth:`.BayesFilter.seed`."""
        states = mean + self._rng.standard_normal((self._count, len(mean))) * std
        self._place(np.where(self._wraps, wrap_angle(states), np.clip(states, self._lower, self._upper)))

    def predict(self, displacement: np.ndarray, travel: float, injected: float = 0.0) -> Prediction:
        """See :meth:`.BayesFilter.predict`; the lightest particles make room for those taken in."""
        left = self._move(displacement, travel)
        if injected:
            count = min(int(self._rng.binomial(self._count, injected)), self._count - 1)
            self._replace_lightest(self._spread(count))
        if self._random:
            self._replace_lightest(self._spread(self._random))
        before, self._ancestors = self._ancestors, np.arange(self._count)
        continued = np.where(before < 0, 0.0, 1.0)
        return Prediction(self._states, self._weights, np.maximum(before, 0), continued, left)

    def _move(self, displacement: np.ndarray, travel: float) -> float:
        """Resample if that is due, and move; returns the fraction that left the scene."""
        self._resample_if_needed()
        self._states = self._motion.sample(self._states, displacement, travel, self._rng)
        if self._wraps.any():
            self._states[:, self._wraps] = wrap_angle(self._states[:, self._wraps])
        inside = self._bounds.contains(self._states)
        kept = float(self._weights[inside].sum())
        if kept <= 0.0:
            self.reset()
            return 1.0
        if not inside.all():
            self._weights = np.where(inside, self._weights, 0.0) / kept
        return 1.0 - min(kept, 1.0)

    def update(self, log_likelihood: np.ndarray) -> Belief:
        """See :meth:`.BayesFilter.update`."""
        self._weights, log_marginal = bayes(self._weights, log_likelihood)
        mean, covariance = moments(self._states, self._weights, self._wraps)
        return Belief(mean, covariance, effective_sample_size(self._weights), self._count, log_marginal)

    def weights(self) -> np.ndarray:
        """See :meth:`.BayesFilter.weights`."""
        return self._weights

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.hypotheses`."""
        return self._states.copy(), self._weights

    def _place(self, states: np.ndarray, ancestors: np.ndarray | int = -1) -> None:
        self._states = states
        self._ancestors = np.broadcast_to(ancestors, self._count).copy()
        self._weights = np.full(self._count, 1.0 / self._count)

    def _spread(self, count: int) -> np.ndarray:
        """``count`` uniform states in a Latin hypercube: as random as independent ones, but without holes."""
        strata = np.stack([self._rng.permutation(count) for _ in range(len(self._lower))], axis=1)
        return self._lower + (strata + self._rng.random(strata.shape)) / count * (self._upper - self._lower)

    def _replace_lightest(self, states: np.ndarray) -> None:
        count = len(states)
        if not count:
            return
        # In random order: after resampling all weigh the same, and neighbours have one ancestor.
        order = self._rng.permutation(self._count)
        lightest = order[np.argpartition(self._weights[order], count - 1)[:count]]
        self._states[lightest] = np.where(self._wraps, states, np.clip(states, self._lower, self._upper))
        self._ancestors[lightest] = -1
        weights = self._weights.copy()
        weights[lightest] = 1.0 / self._count
        self._weights = weights / weights.sum()

    def _resample_if_needed(self) -> None:
        effective = effective_sample_size(self._weights) / self._count
        if self._resample_below < 1.0 and effective >= self._resample_below:
            return
        spread = self._regularization(effective)
        ancestors = systematic(self._weights, self._count, self._rng)
        jitter = self._rng.standard_normal((self._count, len(self._lower))) @ spread.T
        states = self._states.take(ancestors, axis=0) + jitter
        self._place(self._reflected(states), self._ancestors.take(ancestors))

    def _reflected(self, states: np.ndarray) -> np.ndarray:
        """States (P, d) with those beyond a bound mirrored at it: nothing leaves the scene by jitter."""
        beyond = ~self._bounds.contains(states)
        lower, upper = np.array(self._bounds.lower), np.array(self._bounds.upper)
        mirrored = np.where(states[beyond] < lower, 2.0 * lower - states[beyond], states[beyond])
        mirrored = np.where(mirrored > upper, 2.0 * upper - mirrored, mirrored)
        states[beyond] = np.clip(mirrored, lower, upper)
        return states

    def _regularization(self, effective: float) -> np.ndarray:
        """Square root (d, d) of the covariance of the jitter that keeps the copies of one ancestor apart.

        A regularised particle filter (Musso, Oudjane and Le Gland, 2001), with the bandwidth that is optimal
        for a Gaussian belief where half of the particles are effective, and none where all are: then
        resampling makes hardly any copies. It vanishes as the particles grow in number.
        """
        d = len(self._lower)
        bandwidth = (4.0 / ((d + 2.0) * self._count)) ** (1.0 / (d + 4.0))
        copied = math.sqrt(max(2.0 * (1.0 - effective), 0.0))
        _, covariance = moments(self._states, self._weights, self._wraps)
        values, vectors = np.linalg.eigh(covariance)
        return vectors * (copied * bandwidth * np.sqrt(np.maximum(values, 0.0)))
