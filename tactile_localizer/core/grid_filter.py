"""Grid filter: the exact Bayes recursion (paper, Eq. 1 and 2) on cells that cover the scene."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from tactile_localizer.core.bayes_filter import Marginal
from tactile_localizer.core.credit import Credit
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.filters.weights import moments, normalize
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.base import MeasurementModel, flatten_axes
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Scene

_THREE_POINT = 0.6
"""Variance, in cells squared, up to which three points represent a Gaussian step."""
_WORTH_DIFFUSING = 0.02
"""Variance, in cells squared, below which diffusion is saved up: a step costs the same however small."""


class GridFilter:
    """Probability of every cell of the state space; the accuracy limit of any number of particles.

    The cells ride along with the palm: a displacement moves all of them, and only when they have moved by
    half their size are the probabilities shifted by a whole cell. Motion below a cell's size is so
    represented exactly, without the smearing of interpolation. Probability that leaves the scene's bounds is
    lost.

    Parameters
    ----------
    scene : bounds and motion noise
    model : the measurement model; evaluated at the cells' centres
    cell : (d,) largest size of a cell, m (yaw: rad)

    Raises
    ------
    ParameterError
        More cells than memory is meant for.
    """

    MOST_CELLS = 4_000_000

    def __init__(self, scene: Scene, model: MeasurementModel, cell: np.ndarray) -> None:
        extent = scene.upper - scene.lower
        counts = np.maximum(np.ceil(extent / cell - 1e-9), 1.0)
        if float(np.prod(counts)) > self.MOST_CELLS:
            raise ParameterError(
                f"cells: expected at most {self.MOST_CELLS}, got {counts.prod():.3g}; use larger cells"
            )
        self._shape = tuple(int(count) for count in counts)
        self._cell = extent / counts
        self._centres = [
            low + size * (np.arange(count) + 0.5)
            for low, size, count in zip(scene.lower, self._cell, self._shape, strict=True)
        ]
        self._model = model
        self._motion = MotionModel(scene)
        self._wraps = scene.wraps
        self._off = ~scene.on_feature(flatten_axes(self._centres)).reshape(self._shape)
        self._belief: np.ndarray
        self._offset: np.ndarray
        self._pending: np.ndarray
        self.reset()

    def reset(self) -> None:
        """See :meth:`BayesFilter.reset`."""
        self._place(np.ones(self._shape))

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """See :meth:`BayesFilter.seed`. Deviations below half a cell are taken as half a cell."""
        log_density = np.zeros(self._shape)
        for axis, centres in enumerate(self._centres):
            deviation = wrap_angle(centres - mean[axis]) if self._wraps[axis] else centres - mean[axis]
            scaled = deviation / max(std[axis], 0.5 * self._cell[axis])
            others = tuple(a for a in range(len(self._shape)) if a != axis)
            log_density += np.expand_dims(-0.5 * scaled**2, others)
        self._place(np.exp(log_density - log_density.max()))

    def predict(self, displacement: np.ndarray, travel: float) -> None:
        """See :meth:`BayesFilter.predict`."""
        displacement = np.where(self._wraps, wrap_angle(displacement), displacement)
        if (np.abs(displacement) > self._cell * self._shape).any():
            self.reset()
            return
        self._offset = self._offset + displacement
        cells = np.rint(self._offset / self._cell).astype(int)
        if cells.any():
            self._offset -= cells * self._cell
            for axis in np.flatnonzero(cells):
                self._shift(int(axis), int(cells[axis]))
        self._pending = self._pending + self._motion.variance(travel) / self._cell**2
        for axis in np.flatnonzero(self._pending >= _WORTH_DIFFUSING):
            self._diffuse(int(axis))

    def update(self, strain: np.ndarray, present: np.ndarray, exponent: float, credit: Credit) -> Marginal:
        """See :meth:`BayesFilter.update`."""
        log_likelihood = self._model.log_likelihood_on(self._axes(), strain, present)
        with np.errstate(divide="ignore"):
            log_belief = np.log(self._belief)
        _, log_marginal = normalize((log_belief + credit.earned(log_likelihood, self._off)).ravel())
        log_posterior, log_total = normalize((log_belief + exponent * log_likelihood).ravel())
        if log_total > -math.inf:
            self._belief = np.exp(log_posterior).reshape(self._shape)
        return Marginal(log_marginal, log_total)

    def belief(self) -> Belief:
        """See :meth:`BayesFilter.belief`. The spread within a cell counts."""
        weights = self._belief.ravel()
        mean, covariance = moments(flatten_axes(self._axes()), weights, self._wraps)
        covariance += np.diag(self._cell**2 / 12.0 + self._pending * self._cell**2)
        return Belief(mean, covariance, float(1.0 / (weights @ weights)), weights.size)

    def recover(self, fraction: float) -> None:
        """See :meth:`BayesFilter.recover`."""
        self._belief *= 1.0 - fraction
        self._belief += fraction / self._belief.size

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`BayesFilter.hypotheses`."""
        return flatten_axes(self._axes()), self._belief.flatten()

    def relative_density(self, state: np.ndarray) -> float:
        """Density of the belief at a state (d,), over that of a uniform belief; zero outside the scene."""
        place = np.rint((state - self._offset - [c[0] for c in self._centres]) / self._cell).astype(int)
        if (place < 0).any() or (place >= self._shape).any():
            return 0.0
        return float(self._belief[tuple(place)]) * self._belief.size

    def _place(self, belief: np.ndarray) -> None:
        self._belief = belief / belief.sum()
        self._offset = np.zeros(len(self._shape))
        self._pending = np.zeros(len(self._shape))

    def _axes(self) -> list[np.ndarray]:
        return [centres + offset for centres, offset in zip(self._centres, self._offset, strict=True)]

    def _shift(self, axis: int, cells: int) -> None:
        """Move the probabilities along one axis; what leaves a scene that does not wrap is lost."""
        moved = np.roll(self._belief, cells, axis=axis)
        if not self._wraps[axis]:
            emptied = [slice(None)] * moved.ndim
            emptied[axis] = slice(None, cells) if cells > 0 else slice(cells, None)
            moved[tuple(emptied)] = 0.0
        total = moved.sum()
        if total > 0.0:
            self._belief = moved / total
        else:
            self._belief = np.full(self._shape, 1.0 / moved.size)

    def _diffuse(self, axis: int) -> None:
        """Spread by the pending variance: a small one by a three-point step, whose variance is exact."""
        mode = "wrap" if self._wraps[axis] else "constant"
        # A spread as wide as the axis is as good as any wider one.
        variance = min(float(self._pending[axis]), float(self._shape[axis]) ** 2)
        if variance <= _THREE_POINT:
            kernel = [0.5 * variance, 1.0 - variance, 0.5 * variance]
            self._belief = ndimage.correlate1d(self._belief, kernel, axis=axis, mode=mode)
        else:
            self._belief = ndimage.gaussian_filter1d(self._belief, math.sqrt(variance), axis=axis, mode=mode)
        self._belief /= self._belief.sum()
        self._pending[axis] = 0.0
