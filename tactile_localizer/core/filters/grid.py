"""Grid filter: the exact Bayes recursion (paper, Eq. 1 and 2) on cells that cover the scene."""

import math

import numpy as np
from scipy import ndimage

from tactile_localizer.core.filters.base import Prediction
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.lattice import flatten_axes
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.weights import bayes, effective_sample_size, moments
from tactile_localizer.scene import Scene

_THREE_POINT = 0.6
"""Variance, in cells squared, up to which three points represent a Gaussian step."""
_WORTH_DIFFUSING = 0.02
"""Variance, in cells squared, below which diffusion is postponed, because small steps cost as much."""
_NEGLIGIBLE = 1e-5
"""Weight of a cell, relative to that of a uniform belief, below which it is not evaluated. A place that was
ruled out comes back when belief is injected."""


class GridFilter:
    """Probability of every cell; the accuracy limit of any number of particles.

    The cells move with the palm; once they have moved by half their size, the probabilities are shifted by a
    whole cell. So motion by less than a cell is represented exactly.

    Parameters
    ----------
    scene : bounds and motion noise
    cell : (d,) largest size of a cell, m (yaw: rad)

    Raises
    ------
    SceneError
        Too many cells for the memory.
    """

    def __init__(self, scene: Scene, cell: np.ndarray) -> None:
        extent = scene.upper - scene.lower
        counts = scene.cells(cell)
        self._shape = tuple(counts.tolist())
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
        self._belief: np.ndarray
        self._offset: np.ndarray
        self._pending: np.ndarray
        self._alive: np.ndarray
        self._states: np.ndarray
        self._weights: np.ndarray
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

    def predict(self, displacement: np.ndarray, travel: float, injected: float = 0.0) -> Prediction:
        """See :meth:`.BayesFilter.predict`; diffusion between cells does not change a cell's ancestor."""
        before, shifted, left = self._alive, [0] * len(self._shape), 1.0
        if self._turns:
            displacement = np.where(self._wraps, wrap_angle(displacement), displacement)
        if (np.abs(displacement) > self._extent).any():
            self._place(np.ones(self._shape))
            before = before[:0]
        else:
            self._offset = self._offset + displacement
            kept = 1.0
            for axis, cells in enumerate(np.rint(self._offset / self._cell).astype(int).tolist()):
                if cells:
                    shifted[axis] = cells
                    kept *= self._shift(axis, cells)
            self._pending = self._pending + self._motion.variance(travel) / self._cell**2
            for axis, variance in enumerate(self._pending.tolist()):
                if variance >= _WORTH_DIFFUSING:
                    kept *= self._diffuse(axis, variance)
            left = 1.0 - kept
        kept_cells = cells = self._belief.ravel()
        if injected:
            kept_cells = (1.0 - injected) * cells
            cells = kept_cells + injected / self._size
            self._belief = cells.reshape(self._shape)
        self._alive = self._living(cells)
        alive = cells.take(self._alive)
        states = self._unmoved_states.take(self._alive, axis=1)
        states += self._offset[:, None]
        # What has next to no weight is dropped.
        self._states, self._weights = states.T, alive / alive.sum()
        ancestors = self._ancestors(before, shifted)
        continued = np.where(ancestors < 0, 0.0, kept_cells.take(self._alive) / alive)
        return Prediction(self._states, self._weights, np.maximum(ancestors, 0), continued, left)

    def update(self, log_likelihood: np.ndarray) -> Belief:
        """See :meth:`.BayesFilter.update`; the spread within a cell counts."""
        self._weights, log_marginal = bayes(self._weights, log_likelihood)
        belief = np.zeros(self._size)
        belief[self._alive] = self._weights
        self._belief = belief.reshape(self._shape)
        mean, covariance = moments(self._states, self._weights, self._wraps)
        within = self._cell**2 / 12.0 + self._pending * self._cell**2
        covariance.ravel()[:: len(within) + 1] += within
        effective = effective_sample_size(self._weights)
        return Belief(mean, covariance, effective, len(self._alive), log_marginal)

    def weights(self) -> np.ndarray:
        """See :meth:`.BayesFilter.weights`."""
        return self._weights

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.hypotheses`."""
        cells = self._belief.ravel()
        alive = self._living(cells)
        states = self._unmoved_states.take(alive, axis=1).T + self._offset
        return states, cells[alive] / cells[alive].sum()

    def _place(self, belief: np.ndarray) -> None:
        self._belief = belief / belief.sum()
        self._offset = np.zeros(len(self._shape))
        self._pending = np.zeros(len(self._shape))
        self._alive = np.zeros(0, dtype=np.intp)

    def _living(self, cells: np.ndarray) -> np.ndarray:
        """Indices of the cells that have weight."""
        return (cells > _NEGLIGIBLE / self._size).nonzero()[0]

    def _ancestors(self, before: np.ndarray, shifted: list[int]) -> np.ndarray:
        """Index (P,) of the cells ``before`` from which the living ones moved; -1: of none."""
        if len(before) == len(self._alive) and not any(shifted) and np.array_equal(before, self._alive):
            return np.arange(len(before))
        rows = np.full(self._shape, -1)
        rows.ravel()[before] = np.arange(len(before))
        for axis, cells in enumerate(shifted):
            if cells:
                rows = self._rolled(rows, axis, cells, -1)
        return np.asarray(rows.ravel()[self._alive])

    def _deviation(self, axis: int, place: float) -> np.ndarray:
        """Distances of the cells' centres from a place along an axis."""
        deviation = self._unmoved[axis] + self._offset[axis] - place
        return wrap_angle(deviation) if self._wraps[axis] else deviation

    def _shift(self, axis: int, cells: int) -> float:
        """Move the cells along one axis; what leaves a scene that does not wrap is lost."""
        self._offset[axis] -= cells * self._cell[axis]
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
        self._pending[axis] = 0.0
        if variance <= _THREE_POINT:
            beside = self._rolled(self._belief, axis, 1, 0.0) + self._rolled(self._belief, axis, -1, 0.0)
            return self._normalize((1.0 - variance) * self._belief + 0.5 * variance * beside)
        mode = "wrap" if self._wraps[axis] else "constant"
        return self._normalize(ndimage.convolve1d(self._belief, _step(variance), axis, mode=mode))

    def _normalize(self, belief: np.ndarray) -> float:
        """Store a belief scaled to one, and return what it summed to."""
        total = float(belief.sum())
        self._belief = belief / total if total > 0.0 else np.full(belief.shape, 1.0 / self._size)
        return total


def _step(variance: float) -> np.ndarray:
    """Weights of a Gaussian step of a variance, in cells squared, to four deviations."""
    reach = int(4.0 * math.sqrt(variance) + 0.5)
    kernel = np.exp(-0.5 * np.arange(-reach, reach + 1) ** 2 / variance)
    return kernel / kernel.sum()
