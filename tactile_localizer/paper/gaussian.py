"""Single-Gaussian measurement models, with moments of the k nearest training pairs (paper, III-B, Eq. 3)."""

import math

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.likelihood.base import MeasurementModel, checked, training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.paper.background import Background
from tactile_localizer.scene import Scene

_HELD_OUT = 600
"""Held-out strains from which the covariance of residuals is computed."""
_RIDGE = 1e-3
"""Fraction of a channel's variance that is added to the diagonal, so that no direction has zero variance."""


class Gaussian(MeasurementModel):
    """N(z; mean, covariance) over the k training pairs nearest to the state.

    With k at or below the number D of channels the sample covariance is singular, and just above it far too
    small. So it is shrunk towards T, the covariance of held-out residuals, which counts as D + 1 pairs, the
    fewest with a regular covariance (an inverse-Wishart prior):

    .. math:: \\Sigma = \\Big(\\sum_n (z_n - m)(z_n - m)^T + (D + 1)\\,T\\Big) / (k + D)

    Parameters
    ----------
    scan, scene : training pairs and scene
    neighbours : k; 8 in the paper. If there are fewer pairs, all of them

    Raises
    ------
    ParameterError
        Fewer than one neighbour.
    """

    def __init__(self, scan: Scan, scene: Scene, neighbours: int = 8) -> None:
        if neighbours < 1:
            raise ParameterError(f"neighbours: expected at least 1, got {neighbours}")
        positions, strain = training_pairs(scan, scene)
        # Neither a large constant in a channel nor its unit matters.
        self._centre = strain.mean(axis=0)
        strain = strain - self._centre
        self._layout = scene.layout
        self._neighbours = min(neighbours, len(positions))
        self._levers, self._lower = levers(scene), scene.lower
        # The tree takes the period of each axis, zero for none, and places from zero up to it.
        self._period = np.where(scene.wraps, scene.extent * self._levers, 0.0)
        self._strain = strain
        places = self._places(positions)
        self._tree = cKDTree(places, boxsize=self._period)
        residual = self._residuals(places, strain, scan.sweep)
        target = residual.T @ residual / len(residual)
        target += ridge(target, strain)
        self._target = target
        self._background = Background(strain, np.sqrt(np.diag(target)), self._layout)

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """See :meth:`MeasurementModel.log_likelihood`."""
        strain, present = checked(strain, self._layout, present)
        strain = strain - self._centre
        rows = self._nearest(self._tree, self._places(states))
        total = np.zeros(len(states))
        for columns in self._factors(present):
            total += self._log_density(rows, strain, columns)
        return self._background.mixed(total, strain, present)

    def _places(self, states: np.ndarray) -> np.ndarray:
        """States (P, d) in metres of travel from the lower bounds, on full-turn axes within a period."""
        places = (states - self._lower) * self._levers
        return np.where(self._period > 0.0, places % np.maximum(self._period, 1e-300), places)

    def _nearest(self, tree: cKDTree, places: np.ndarray) -> np.ndarray:
        """Indices (P, k) of the k points of a tree that are nearest to ``places`` (P, d)."""
        return tree.query(places, k=np.arange(1, self._neighbours + 1))[1]

    def _factors(self, present: np.ndarray) -> list[np.ndarray]:
        """Channels of each factor of the density: those of the phalanges ``present`` (F,) together."""
        return [np.flatnonzero(self._layout.expand(present))]

    def _log_density(self, rows: np.ndarray, strain: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Log-densities (P,) of some columns of a strain (C,), for neighbours (P, k)."""
        samples = self._strain[rows[..., None], columns]
        mean = samples.mean(axis=1)
        spread = samples - mean[:, None, :]
        dimension = len(columns)
        covariance = (
            np.swapaxes(spread, 1, 2) @ spread + (dimension + 1.0) * self._target[np.ix_(columns, columns)]
        )
        factor = np.linalg.cholesky(covariance / (rows.shape[1] + dimension))
        white = np.linalg.solve(factor, (strain[columns] - mean)[..., None])[..., 0]
        log_determinant = 2.0 * np.log(np.einsum("pcc->pc", factor)).sum(axis=1)
        squared = np.einsum("pc,pc->p", white, white)
        return -0.5 * (squared + log_determinant + dimension * math.log(2.0 * math.pi))

    def _residuals(self, places: np.ndarray, strain: np.ndarray, sweep: np.ndarray) -> np.ndarray:
        """Residuals (M, C) of held-out strains from the mean of their neighbours in other sweeps."""
        if len(np.unique(sweep)) == 1:
            sweep = np.arange(len(sweep)) * 8 // len(sweep)
        chosen = np.unique(np.linspace(0, len(places) - 1, _HELD_OUT).astype(int))
        residuals = []
        for number in np.unique(sweep[chosen]):
            own = chosen[sweep[chosen] == number]
            others = np.flatnonzero(sweep != number)
            if len(others) < self._neighbours:
                others = np.arange(len(places))
            tree = cKDTree(places[others], boxsize=self._period)
            neighbours = others[self._nearest(tree, places[own])]
            residuals.append(strain[own] - strain[neighbours].mean(axis=1))
        return np.concatenate(residuals)


class IndependentGaussian(Gaussian):
    """The same without covariance between the phalanges (dashed line in the paper's Fig. 5)."""

    def _factors(self, present: np.ndarray) -> list[np.ndarray]:
        every = self._layout.split(np.arange(self._layout.size))
        return [own for own, here in zip(every, present, strict=True) if here]


def ridge(covariance: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Diagonal (D, D) that makes ``covariance`` positive definite, even for a channel that never varies.

    It is relative to the strain, whose unit does not matter.
    """
    spread = np.ptp(samples, axis=0)
    least = 1e-12 * (float(spread.max()) or 1.0)
    return np.diag(_RIDGE * np.diag(covariance) + (1e-6 * spread) ** 2 + least**2)
