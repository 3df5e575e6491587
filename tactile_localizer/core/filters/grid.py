"""Grid filter: the exact Bayes recursion (paper, Eq. 1 and 2) on cells that cover the scene."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.filters.blocks import MOST_APART, Blocks
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.base import flatten_axes
from tactile_localizer.core.likelihood.weights import moments
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Scene

_THREE_POINT = 0.6
"""Variance, in cells squared, up to which three points represent a Gaussian step."""
_WORTH_DIFFUSING = 0.02
"""Variance, in cells squared, below which diffusion is postponed, because small steps cost as much."""
_NEGLIGIBLE = 1e-5
"""Weight of a cell, relative to that of a uniform belief, below which it is not evaluated. A place that was
ruled out comes back when belief is injected. With 1e-7 nothing changed; with 1e-3 one of 16 simulated sweeps
of a turned hand had twice the error."""


class GridFilter:
    """Probability of every cell; the accuracy limit of any number of particles.

    The cells move with the palm; once they have moved by half their size, the probabilities are shifted by a
    whole cell. So motion by less than a cell is represented exactly.

    Parameters
    ----------
    scene : bounds and motion noise
    cell : (d,) largest size of a cell, m (yaw: rad)
    coarse : (d,) largest size of a block of cells that is one hypothesis where the belief has no detail;
        ``None``: every cell is one, as :meth:`ancestors` needs

    Raises
    ------
    ParameterError
        Too many cells for the memory.
    """

    MOST_CELLS = 4_000_000

    def __init__(self, scene: Scene, cell: np.ndarray, coarse: np.ndarray | None = None) -> None:
        extent = scene.upper - scene.lower
        counts = np.maximum(np.ceil(extent / cell - 1e-9), 1.0)
        if float(np.prod(counts)) > self.MOST_CELLS:
            raise ParameterError(
                f"cells: expected at most {self.MOST_CELLS}, got {counts.prod():.3g}; use larger cells"
            )
        self._shape = tuple(int(count) for count in counts)
        self._cell = extent / counts
        self._unmoved = [
            low + size * (np.arange(count) + 0.5)
            for low, size, count in zip(scene.lower, self._cell, self._shape, strict=True)
        ]
        # An axis at a time: arrays with a short last axis take several times longer.
        self._unmoved_states = np.ascontiguousarray(flatten_axes(self._unmoved).T)
        self._motion = MotionModel(scene)
        self._wraps, self._turns = scene.wraps, bool(scene.wraps.any())
        self._extent = extent
        self._size = int(np.prod(self._shape))
        self._blocks: Blocks | None = None
        if coarse is not None and self._size > MOST_APART:
            self._blocks = Blocks(self._unmoved, np.maximum((coarse / self._cell + 1e-9).astype(int), 1))
        self._in_blocks = False
        self._belief: np.ndarray
        self._offset: np.ndarray
        self._pending: np.ndarray
        self._alive: np.ndarray
        self._shifted: np.ndarray
        self._weighted: np.ndarray | None  # of the states, where these are cells and nothing moved since
        self.reset()

    def reset(self) -> None:
        """See :meth:`.BayesFilter.reset`."""
        self._place(np.ones(self._shape))

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """See :meth:`.BayesFilter.seed`; standard deviations are at least half a cell."""
        self._place(np.ones(self._shape))
        log_density = np.zeros(self._shape)
        for axis in range(len(self._shape)):
            scaled = self._deviation(axis, mean[axis]) / max(std[axis], 0.5 * self._cell[axis])
            others = tuple(a for a in range(len(self._shape)) if a != axis)
            log_density += np.expand_dims(-0.5 * scaled**2, others)
        self._place(np.exp(log_density - log_density.max()))

    def predict(self, displacement: np.ndarray, travel: float) -> float:
        """See :meth:`.BayesFilter.predict`."""
        if self._turns:
            displacement = np.where(self._wraps, wrap_angle(displacement), displacement)
        if (np.abs(displacement) > self._extent).any():
            self.reset()
            return 1.0
        self._weighted = None
        self._offset = self._offset + displacement
        kept = 1.0
        for axis, cells in enumerate(np.rint(self._offset / self._cell).tolist()):
            if cells:
                kept *= self._shift(axis, int(cells))
        self._pending = self._pending + self._motion.variance(travel) / self._cell**2
        for axis, variance in enumerate(self._pending.tolist()):
            if variance >= _WORTH_DIFFUSING:
                kept *= self._diffuse(axis, variance)
        return 1.0 - kept

    def inject(self, fraction: float) -> None:
        """See :meth:`.BayesFilter.inject`."""
        self._injected = fraction / self._size
        if self._injected:
            self._weighted = None
            self._belief = (1.0 - fraction) * self._belief
            self._belief += self._injected

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.prior`; a state is a cell, or a block of them."""
        self._weighted = None
        self._before, self._shift_since = self._alive, self._shifted
        self._shifted = np.zeros_like(self._shifted)
        weights = self._belief.ravel()
        self._alive = self._living(weights)
        self._in_blocks = self._blocks is not None and len(self._alive) > MOST_APART
        if self._blocks is not None and self._in_blocks:
            self._alive = self._blocks.divide(weights)
            own = self._unmoved_states.take(self._alive, axis=1)
            states = np.concatenate([own, self._blocks.centres], axis=1)
            self._weights = np.concatenate([weights[self._alive], self._blocks.masses])
        else:
            states = self._unmoved_states.take(self._alive, axis=1)
            self._weights = weights.take(self._alive)
        self._log_prior = np.log(self._weights)
        states += self._offset[:, None]
        self._states = states.T
        return self._states, self._log_prior

    def ancestors(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.ancestors`; a cell's is where it was, and diffusion counts for nothing."""
        rows = np.full(self._shape, -1)
        rows.ravel()[self._before] = np.arange(len(self._before))
        for axis in np.flatnonzero(self._shift_since):
            rows = self._rolled(rows, int(axis), int(self._shift_since[axis]), -1)
        index = rows.ravel()[self._alive]
        return np.maximum(index, 0), np.where(index < 0, 0.0, 1.0 - self._injected / self._weights)

    def update(self, log_likelihood: np.ndarray) -> None:
        """See :meth:`.BayesFilter.update`."""
        log_posterior = self._log_prior + log_likelihood
        peak = log_posterior.max()
        if peak > -math.inf:
            log_posterior -= peak
            posterior = np.exp(log_posterior, out=log_posterior)
            posterior /= posterior.sum()
            self._weighted = None if self._in_blocks else posterior
            apart, belief = len(self._alive), np.zeros(self._size)
            if self._blocks is not None and self._in_blocks:
                belief = self._blocks.spread(posterior[apart:])
            belief[self._alive] = posterior[:apart]
            self._belief = belief.reshape(self._shape)

    def belief(self) -> Belief:
        """See :meth:`.BayesFilter.belief`; the spread within a cell counts."""
        within = self._cell**2 / 12.0 + self._pending * self._cell**2
        if self._weighted is not None:
            mean, covariance = moments(self._states, self._weighted, self._wraps)
            covariance.ravel()[:: len(within) + 1] += within
            return self._summary(mean, covariance, self._weighted)
        dimension = len(self._shape)
        marginals = [self._marginal(axis) for axis in range(dimension)]
        mean = np.empty(dimension)
        for axis, weights in enumerate(marginals):
            centres = self._centres(axis)
            mean[axis] = weights @ centres
            if self._wraps[axis]:
                mean[axis] = math.atan2(weights @ np.sin(centres), weights @ np.cos(centres))
        deviations = [self._deviation(axis, mean[axis]) for axis in range(dimension)]
        covariance = np.diag(within)
        for a in range(dimension):
            covariance[a, a] += marginals[a] @ deviations[a] ** 2
            for b in range(a):
                covariance[a, b] = covariance[b, a] = deviations[b] @ self._marginal(b, a) @ deviations[a]
        return self._summary(mean, covariance, self._belief.ravel())

    def mass_near(self, mean: np.ndarray, radius: np.ndarray) -> float:
        """See :meth:`.BayesFilter.mass_near`."""
        if self._weighted is not None:
            away = (self._states - mean).T
            if self._turns:
                away = np.where(self._wraps[:, None], wrap_angle(away), away)
            away /= radius[:, None]
            return float(self._weighted[np.square(away, out=away).sum(axis=0) <= 1.0].sum())
        squared, near = np.zeros(()), []
        for axis, half in enumerate(radius):
            along = (self._deviation(axis, mean[axis]) / half) ** 2
            near.append(np.flatnonzero(along <= 1.0))
            squared = np.add.outer(squared, along[near[-1]])
        return float(self._belief[np.ix_(*near)][squared <= 1.0].sum())

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.hypotheses`."""
        weights = self._belief.ravel()
        alive = self._living(weights)
        states = self._unmoved_states.take(alive, axis=1).T + self._offset
        return states, weights[alive] / weights[alive].sum()

    def _place(self, belief: np.ndarray) -> None:
        self._belief = belief / belief.sum()
        self._offset = np.zeros(len(self._shape))
        self._pending = np.zeros(len(self._shape))
        self._alive = np.zeros(0, dtype=np.intp)
        self._shifted = np.zeros(len(self._shape), dtype=int)
        self._injected = 0.0
        self._weighted = None

    def _living(self, weights: np.ndarray) -> np.ndarray:
        """Indices of the cells that have weight."""
        return (weights > _NEGLIGIBLE / self._size).nonzero()[0]

    def _summary(self, mean: np.ndarray, covariance: np.ndarray, weights: np.ndarray) -> Belief:
        """A belief with these moments and weights (P,)."""
        return Belief(mean, covariance, 1.0 / float(weights @ weights), len(self._living(weights)))

    def _centres(self, axis: int) -> np.ndarray:
        """Centres of the cells along an axis."""
        return self._unmoved[axis] + self._offset[axis]

    def _deviation(self, axis: int, place: float) -> np.ndarray:
        """Distances of the cells' centres from a place along an axis."""
        deviation = self._centres(axis) - place
        return wrap_angle(deviation) if self._wraps[axis] else deviation

    def _marginal(self, *axes: int) -> np.ndarray:
        """Probabilities along one or two axes."""
        others = tuple(axis for axis in range(len(self._shape)) if axis not in axes)
        return self._belief.sum(axis=others) if others else self._belief

    def _shift(self, axis: int, cells: int) -> float:
        """Move the cells along one axis; what leaves a scene that does not wrap is lost."""
        self._offset[axis] -= cells * self._cell[axis]
        self._shifted[axis] += cells
        return self._normalize(self._rolled(self._belief, axis, cells, 0.0))

    def _rolled(self, values: np.ndarray, axis: int, cells: int, empty: float) -> np.ndarray:
        """Values of the cells that were there before the cells moved, ``empty`` where there were none."""
        if self._wraps[axis]:
            return np.roll(values, cells, axis=axis)
        moved = np.full_like(values, empty)
        to, of = slice(cells, None), slice(None, -cells)
        if cells < 0:
            to, of = slice(None, cells), slice(-cells, None)
        moved.swapaxes(0, axis)[to] = values.swapaxes(0, axis)[of]
        return moved

    def _diffuse(self, axis: int, variance: float) -> float:
        """Spread by the pending variance: a small one by a three-point step, whose variance is exact."""
        # A spread as wide as the axis is as good as any wider one.
        variance = min(variance, float(self._shape[axis]) ** 2)
        if variance <= _THREE_POINT:
            spread = _three_point(self._belief, variance, axis, bool(self._wraps[axis]))
        else:
            spread = _gaussian(self._belief, variance, axis, bool(self._wraps[axis]))
        self._pending[axis] = 0.0
        return self._normalize(spread)

    def _normalize(self, belief: np.ndarray) -> float:
        """Store a belief scaled to one, and return what it summed to."""
        total = float(belief.sum())
        self._belief = belief / total if total > 0.0 else np.full(belief.shape, 1.0 / self._size)
        return total


def _three_point(belief: np.ndarray, variance: float, axis: int, wraps: bool) -> np.ndarray:
    """Spread along an axis over the neighbouring cells, by a variance in cells squared."""
    spread = (1.0 - variance) * belief
    beside = 0.5 * variance * belief
    to, moved = spread.swapaxes(0, axis), beside.swapaxes(0, axis)
    to[1:] += moved[:-1]
    to[:-1] += moved[1:]
    if wraps:
        to[0] += moved[-1]
        to[-1] += moved[0]
    return spread


def _gaussian(belief: np.ndarray, variance: float, axis: int, wraps: bool) -> np.ndarray:
    """Spread along an axis by a Gaussian of four standard deviations to either side."""
    reach = int(4.0 * math.sqrt(variance) + 0.5)
    kernel = np.exp(-0.5 * np.arange(-reach, reach + 1) ** 2 / variance)
    widths = [(reach, reach) if each == axis else (0, 0) for each in range(belief.ndim)]
    padded = np.pad(belief, widths, mode="wrap" if wraps else "constant")
    return np.apply_along_axis(np.convolve, axis, padded, kernel / kernel.sum(), "valid")
