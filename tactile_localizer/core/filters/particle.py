"""Particle filter: sampling importance resampling (paper, III-A and its reference [7])."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.filters.resampling import resampler
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.weights import effective_sample_size, moments, normalize
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Region, Scene


class ParticleFilter:
    """Weighted particles, resampled before they are moved, so that copies get process noise of their own.

    Parameters
    ----------
    scene : bounds and motion noise; outside the bounds the weight is zero
    rng : the only source of randomness
    particles : how many; the paper uses 75
    resampling : one of :data:`~tactile_localizer.core.filters.resampling.RESAMPLERS`
    resample_below : resample when the effective sample size falls below this share of particles; 1: always
    random_particles : replace this many by uniformly random ones at each update, as the paper does (10)

    Raises
    ------
    ParameterError
        A count or share out of its range.
    """

    def __init__(
        self,
        scene: Scene,
        rng: np.random.Generator,
        particles: int = 75,
        resampling: str = "systematic",
        resample_below: float = 0.5,
        random_particles: int = 0,
    ) -> None:
        if particles < 1:
            raise ParameterError(f"particles: expected at least 1, got {particles}")
        if not 0.0 < resample_below <= 1.0:
            raise ParameterError(f"resample_below: expected a share in (0, 1], got {resample_below}")
        if not 0 <= random_particles < particles:
            raise ParameterError(f"random_particles: expected 0 to {particles - 1}, got {random_particles}")
        self._motion = MotionModel(scene)
        self._rng = rng
        self._count = particles
        self._resample = resampler(resampling)
        self._resample_below = resample_below
        self._random = random_particles
        self._lower, self._upper, self._wraps = scene.lower, scene.upper, scene.wraps
        self._bounds = Region(tuple(self._lower), tuple(self._upper))
        self._states: np.ndarray
        self._log_weights: np.ndarray
        self._ancestors: np.ndarray
        self.reset()

    def reset(self) -> None:
        """See :meth:`.BayesFilter.reset`; stratified over the scene, so that few particles cover it."""
        self._place(self._spread(self._count))

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """See :meth:`.BayesFilter.seed`."""
        states = mean + self._rng.standard_normal((self._count, len(mean))) * std
        self._place(np.where(self._wraps, wrap_angle(states), np.clip(states, self._lower, self._upper)))

    def predict(self, displacement: np.ndarray, travel: float) -> float:
        """See :meth:`.BayesFilter.predict`."""
        self._resample_if_needed()
        self._states = self._motion.sample(self._states, displacement, travel, self._rng)
        if self._wraps.any():
            self._states[:, self._wraps] = wrap_angle(self._states[:, self._wraps])
        inside = self._bounds.contains(self._states)
        kept = float(np.exp(self._log_weights[inside]).sum())
        if not inside.any() or kept <= 0.0:
            self.reset()
            return 1.0
        if not inside.all():
            self._log_weights = np.where(inside, self._log_weights, -math.inf)
            self._log_weights, _ = normalize(self._log_weights)
        return 1.0 - min(kept, 1.0)

    def inject(self, fraction: float) -> None:
        """See :meth:`.BayesFilter.inject`: the lightest make room, each new one has average weight."""
        count = min(int(self._rng.binomial(self._count, min(fraction, 1.0))), self._count - 1)
        if count:
            self._replace_lightest(count)

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.prior`."""
        if self._random:
            self._replace_lightest(self._random)
        self._before, self._ancestors = self._ancestors, np.arange(self._count)
        return self._states, self._log_weights

    def ancestors(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.ancestors`."""
        return np.maximum(self._before, 0), np.where(self._before < 0, 0.0, 1.0)

    def update(self, log_likelihood: np.ndarray) -> None:
        """See :meth:`.BayesFilter.update`."""
        log_weights, log_total = normalize(self._log_weights + log_likelihood)
        if log_total > -math.inf:
            self._log_weights = log_weights

    def belief(self) -> Belief:
        """See :meth:`.BayesFilter.belief`."""
        mean, covariance = moments(self._states, np.exp(self._log_weights), self._wraps)
        return Belief(mean, covariance, effective_sample_size(self._log_weights), len(self._states))

    def mass_near(self, mean: np.ndarray, radius: np.ndarray) -> float:
        """See :meth:`.BayesFilter.mass_near`."""
        deviation = self._states - mean
        if self._wraps.any():
            deviation[:, self._wraps] = wrap_angle(deviation[:, self._wraps])
        inside = np.square(deviation / radius) @ np.ones(len(radius)) <= 1.0
        return float(np.exp(self._log_weights[inside]).sum())

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.hypotheses`."""
        return self._states.copy(), np.exp(self._log_weights)

    def _place(self, states: np.ndarray) -> None:
        count = len(states)
        self._states = states
        self._ancestors = np.full(count, -1)
        self._log_weights = np.full(count, -math.log(count))

    def _spread(self, count: int) -> np.ndarray:
        """``count`` uniform states in a Latin hypercube: as random as independent ones, but without holes."""
        strata = np.stack([self._rng.permutation(count) for _ in range(len(self._lower))], axis=1)
        return self._lower + (strata + self._rng.random(strata.shape)) / count * (self._upper - self._lower)

    def _replace_lightest(self, count: int) -> None:
        # In random order: after resampling all weigh the same, and neighbours have one ancestor.
        order = self._rng.permutation(len(self._states))
        lightest = order[np.argpartition(self._log_weights[order], count - 1)[:count]]
        self._states[lightest] = self._spread(count)
        self._ancestors[lightest] = -1
        self._log_weights[lightest] = -math.log(len(self._states))
        self._log_weights, _ = normalize(self._log_weights)

    def _resample_if_needed(self) -> None:
        if (
            self._resample_below < 1.0
            and effective_sample_size(self._log_weights) >= self._resample_below * self._count
        ):
            return
        weights = np.exp(self._log_weights)
        spread = self._regularization(weights)
        ancestors = self._resample(weights, self._count, self._rng)
        jitter = self._rng.standard_normal((self._count, len(self._lower))) @ spread.T
        self._states = self._reflected(self._states[ancestors] + jitter)
        self._ancestors = self._ancestors[ancestors]
        self._log_weights = np.full(self._count, -math.log(self._count))

    def _reflected(self, states: np.ndarray) -> np.ndarray:
        """States (P, d) with those beyond a bound mirrored at it: nothing leaves the scene by jitter."""
        lower = np.where(self._wraps, -math.inf, self._lower)
        upper = np.where(self._wraps, math.inf, self._upper)
        mirrored = np.where(states < lower, 2.0 * lower - states, states)
        mirrored = np.where(mirrored > upper, 2.0 * upper - mirrored, mirrored)
        return np.where(self._wraps, states, np.clip(mirrored, self._lower, self._upper))

    def _regularization(self, weights: np.ndarray) -> np.ndarray:
        """Square root (d, d) of the covariance of the jitter that keeps the copies of one ancestor apart.

        A regularised particle filter (Musso, Oudjane and Le Gland, 2001): half the bandwidth that is optimal
        for a Gaussian belief, which vanishes as the particles grow in number.
        """
        d = len(self._lower)
        bandwidth = 0.5 * (4.0 / ((d + 2.0) * len(weights))) ** (1.0 / (d + 4.0))
        _, covariance = moments(self._states, weights, self._wraps)
        values, vectors = np.linalg.eigh(covariance)
        return vectors * (bandwidth * np.sqrt(np.maximum(values, 0.0)))
