"""Single-Gaussian measurement models, with moments of the k nearest training pairs (paper, III-B, Eq. 3)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtri

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.likelihood.background import Background
from tactile_localizer.core.likelihood.base import MeasurementModel, checked, training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Scene

_INTENSITIES = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.97, 1.0)
"""Candidates for the intensity of the shrinkage."""
_HELD_OUT = 600
"""Held-out strains by which the shrinkage is chosen."""
_RIDGE = 1e-3
"""Fraction of a channel's variance that is added to the diagonal, so that no direction has zero variance."""


class Shrinkage(NamedTuple):
    """Regularization of the covariance of k neighbours.

    .. math:: \\Sigma = c\\,((1 - \\lambda)\\,S + \\lambda\\,T)

    with S the neighbours' sample covariance and T that of all held-out residuals.

    Parameters
    ----------
    intensity : lambda, chosen by the log-likelihood of held-out sweeps
    scale : c, chosen so that the median squared Mahalanobis distance of held-out strains is that of a normal
        distribution
    """

    intensity: float
    scale: float


class Gaussian(MeasurementModel):
    """N(z; mean, covariance) over the k training pairs nearest to the state.

    With k at or below the number of channels the sample covariance is singular, and just above it far too
    small. It is shrunk towards the covariance of held-out residuals (:class:`Shrinkage`).

    Parameters
    ----------
    scan, scene : training pairs and scene
    neighbours : k; 8 in the paper. If there are fewer pairs, all of them
    independent : whether the covariance between phalanges is zero (dashed line in the paper's Fig. 5)

    Raises
    ------
    ParameterError
        Fewer than one neighbour.
    """

    def __init__(self, scan: Scan, scene: Scene, neighbours: int = 8, independent: bool = False) -> None:
        if neighbours < 1:
            raise ParameterError(f"neighbours: expected at least 1, got {neighbours}")
        positions, strain = training_pairs(scan, scene)
        self._layout = scene.layout
        self._neighbours = min(neighbours, len(positions))
        self._independent = independent
        self._levers, self._lower = levers(scene), scene.lower
        # The tree takes the period of each axis, zero for none, and places from zero up to it.
        self._period = np.where(scene.wraps, scene.extent * self._levers, 0.0)
        self._strain = strain
        places = self._places(positions)
        self._tree = cKDTree(places, boxsize=self._period)
        residual, rows, held_out = self._held_out(places, strain, scan.sweep)
        target = residual.T @ residual / len(residual)
        target += ridge(target, strain)
        self._target = target
        self._background = Background(strain, np.sqrt(np.diag(target)), self._layout)
        self.shrinkage = self._choose_shrinkage(rows, held_out)

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """See :meth:`MeasurementModel.log_likelihood`."""
        strain, present = checked(strain, self._layout, present)
        rows = self._nearest(self._tree, self._places(states))
        total = np.zeros(len(states))
        for columns in self._factors(present):
            squared, log_determinant = self._distance(rows, strain, columns, self.shrinkage.intensity)
            total -= 0.5 * (squared / self.shrinkage.scale + log_determinant)
            total -= 0.5 * len(columns) * math.log(2.0 * math.pi * self.shrinkage.scale)
        return self._background.mixed(total, strain, present)

    def _places(self, states: np.ndarray) -> np.ndarray:
        """States (P, d) in metres of travel from the lower bounds, on full-turn axes within a period."""
        places = (states - self._lower) * self._levers
        return np.where(self._period > 0.0, places % np.maximum(self._period, 1e-300), places)

    def _nearest(self, tree: cKDTree, places: np.ndarray) -> np.ndarray:
        """Indices (P, k) of the k points of a tree that are nearest to ``places`` (P, d)."""
        return tree.query(places, k=np.arange(1, self._neighbours + 1))[1]

    def _factors(self, present: np.ndarray) -> list[np.ndarray]:
        """Channels of each factor of the density: those of each present phalanx, or of all together."""
        if self._independent:
            every = self._layout.split(np.arange(self._layout.size))
            return [own for own, here in zip(every, present, strict=True) if here]
        return [np.flatnonzero(self._layout.expand(present))]

    def _distance(
        self, rows: np.ndarray, strain: np.ndarray, columns: np.ndarray, intensity: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Squared Mahalanobis distance and log-determinant, (P,) each and unscaled, for neighbours (P, k).

        ``strain`` is one vector (C,), or one per row (P, C).
        """
        samples = self._strain[rows[..., None], columns]
        mean = samples.mean(axis=1)
        spread = samples - mean[:, None, :]
        covariance = np.swapaxes(spread, 1, 2) @ spread * ((1.0 - intensity) / rows.shape[1])
        covariance += intensity * self._target[np.ix_(columns, columns)]
        factor = np.linalg.cholesky(covariance)
        white = np.linalg.solve(factor, (np.atleast_2d(strain)[:, columns] - mean)[..., None])[..., 0]
        log_determinant = 2.0 * np.log(np.einsum("pcc->pc", factor)).sum(axis=1)
        return np.einsum("pc,pc->p", white, white), log_determinant

    def _held_out(
        self, places: np.ndarray, strain: np.ndarray, sweep: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (M, C) of held-out strains, their neighbours (M, k) in other sweeps, and the strains."""
        if len(np.unique(sweep)) == 1:
            sweep = np.arange(len(sweep)) * 8 // len(sweep)
        chosen = np.unique(np.linspace(0, len(places) - 1, _HELD_OUT).astype(int))
        rows, samples = [], []
        for number in np.unique(sweep[chosen]):
            own = chosen[sweep[chosen] == number]
            others = np.flatnonzero(sweep != number)
            if len(others) < self._neighbours:
                others = np.arange(len(places))
            tree = cKDTree(places[others], boxsize=self._period)
            rows.append(others[self._nearest(tree, places[own])])
            samples.append(strain[own])
        neighbours, held_out = np.concatenate(rows), np.concatenate(samples)
        return held_out - strain[neighbours].mean(axis=1), neighbours, held_out

    def _choose_shrinkage(self, rows: np.ndarray, held_out: np.ndarray) -> Shrinkage:
        factors = self._factors(np.ones(self._layout.phalanges, dtype=bool))
        dimension = sum(len(columns) for columns in factors)
        expected = float(chdtri(dimension, 0.5))

        def evaluate(intensity: float) -> tuple[float, Shrinkage]:
            parts = [self._distance(rows, held_out, columns, intensity) for columns in factors]
            squared, log_determinant = np.sum(parts, axis=0)
            scale = max(float(np.median(squared)) / expected, 1e-12)
            # The median, because outliers are explained by the background.
            score = np.median(-0.5 * (squared / scale + log_determinant + dimension * math.log(scale)))
            return float(score), Shrinkage(intensity, scale)

        return max(map(evaluate, _INTENSITIES), key=lambda scored: scored[0])[1]


def ridge(covariance: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Diagonal (D, D) that makes ``covariance`` positive definite, even for a channel that never varies."""
    size = np.abs(samples).max(axis=0)
    return np.diag(_RIDGE * np.diag(covariance) + (1e-6 * size) ** 2 + 1e-24)
