"""Grid filter: the exact Bayes recursion (paper, Eq. 1 and 2) on cells that cover the scene."""

import numpy as np

from tactile_localizer.core.filters.base import Prediction
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.filters.grid_motion import MovedCells
from tactile_localizer.core.filters.living import Living
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.lattice import flatten_axes
from tactile_localizer.core.weights import bayes, effective_sample_size, moments
from tactile_localizer.scene import Scene

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
        cell = extent / counts
        self._cell, self._extent = cell.tolist(), extent.tolist()
        self._unmoved = [
            low + size * (np.arange(count) + 0.5)
            for low, size, count in zip(scene.lower, self._cell, self._shape, strict=True)
        ]
        # An axis at a time: arrays with a short last axis take several times longer.
        self._unmoved_states = np.ascontiguousarray(flatten_axes(self._unmoved).T)
        self._wraps, self._turns = scene.wraps, bool(scene.wraps.any())
        self._rate = (scene.motion_std**2 / cell**2).tolist()
        self._size = int(np.prod(self._shape))
        self._belief: np.ndarray
        self._offset: list[float]
        self._pending: list[float]
        self._numbers: np.ndarray
        self._living: Living
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
        shifted, left = [0] * len(self._shape), 1.0
        along = displacement.tolist()
        if self._turns:
            along = np.where(self._wraps, wrap_angle(displacement), displacement).tolist()
        if any(abs(each) > extent for each, extent in zip(along, self._extent, strict=True)):
            self._place(np.ones(self._shape))
        else:
            # Of a few numbers, a loop is several times faster than arrays.
            for axis, (each, cell, rate) in enumerate(zip(along, self._cell, self._rate, strict=True)):
                self._offset[axis] += each
                shifted[axis] = round(self._offset[axis] / cell)
                self._offset[axis] -= shifted[axis] * cell
                self._pending[axis] += travel * rate
            spread = [each if each >= _WORTH_DIFFUSING else 0.0 for each in self._pending]
            left = 0.0
            if any(shifted) or any(spread):
                self._pending = [each if each < _WORTH_DIFFUSING else 0.0 for each in self._pending]
                moved = MovedCells.of(self._belief, self._numbers, shifted, spread, self._wraps)
                self._belief, self._numbers, left = moved.belief, moved.numbers, 1.0 - moved.kept
        kept_cells = cells = self._belief.ravel()
        if injected:
            kept_cells = (1.0 - injected) * cells
            cells = kept_cells + injected / self._size
            self._belief = cells.reshape(self._shape)
        offset, least = np.array(self._offset), _NEGLIGIBLE / self._size
        of = Living.of(cells, kept_cells, self._numbers.ravel(), self._unmoved_states, offset, least)
        self._living, self._weights, self._numbers = of, of.weights, of.numbers.reshape(self._shape)
        return Prediction(of.states.T, of.weights, of.ancestors, of.continued, left)

    def update(self, log_likelihood: np.ndarray) -> Belief:
        """See :meth:`.BayesFilter.update`; the spread within a cell counts."""
        self._weights, log_marginal = bayes(self._weights, log_likelihood)
        belief = np.zeros(self._size)
        belief[self._living.cells] = self._weights
        self._belief = belief.reshape(self._shape)
        mean, covariance = moments(self._living.states.T, self._weights, self._wraps)
        for axis, (pending, cell) in enumerate(zip(self._pending, self._cell, strict=True)):
            covariance[axis, axis] += (1.0 / 12.0 + pending) * cell**2
        effective = effective_sample_size(self._weights)
        return Belief(mean, covariance, effective, len(self._weights), log_marginal)

    def weights(self) -> np.ndarray:
        """See :meth:`.BayesFilter.weights`."""
        return self._weights

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.BayesFilter.hypotheses`."""
        cells = self._belief.ravel()
        alive = (cells > _NEGLIGIBLE / self._size).nonzero()[0]
        states = self._unmoved_states.take(alive, axis=1).T + np.array(self._offset)
        return states, cells[alive] / cells[alive].sum()

    def _place(self, belief: np.ndarray) -> None:
        self._belief = belief / belief.sum()
        self._offset = [0.0] * len(self._shape)
        self._pending = [0.0] * len(self._shape)
        self._numbers = np.full(self._shape, -1)

    def _deviation(self, axis: int, place: float) -> np.ndarray:
        """Distances of the cells' centres from a place along an axis."""
        deviation = self._unmoved[axis] + self._offset[axis] - place
        return wrap_angle(deviation) if self._wraps[axis] else deviation
