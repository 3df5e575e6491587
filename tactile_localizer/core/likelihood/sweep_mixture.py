"""Sweep mixture: a place feels as an interpolation between two sweeps on either side of it."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from tactile_localizer.core.likelihood.evaluation import Evaluation, Expected
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import log_density

INFLATION = 9.0
"""Factor of the variance under which a strain fits unknown material: three standard deviations. By judgement;
tried on two fabrics and three simulated features."""
_ELSEWHERE_PLACES = 400
"""Places that stand for the whole map in the likelihood of a strain that was felt anywhere."""


class SweepMixture:
    """Student-t mixture over pairs of sweeps on either side of a place, from tables (:class:`.StrainMap`).

    Parameters
    ----------
    noise : coordinates in which a visit's noise is white
    strain_map : tables of expectation and variance
    cell : (d,) size of a grid filter's cells, for which the tables were made, m (yaw: rad)
    information_length : m of travel that make one independent measurement of the position
    presence_length : m of travel that make one independent test of whether the map applies
    """

    def __init__(
        self,
        noise: NoiseModel,
        strain_map: StrainMap,
        cell: np.ndarray,
        information_length: float,
        presence_length: float,
    ) -> None:
        self.noise, self.map, self.cell = noise, strain_map, cell
        self.information_length, self.presence_length = information_length, presence_length
        self.offset_variance = noise.offset_variance
        layout = noise.layout
        self._featureless_variance = strain_map.featureless_variance
        self._parts = [np.ascontiguousarray(strain_map.mean[..., own]) for own in layout.slices]
        self._squares = [np.einsum("mkc,mkc->mk", part, part) for part in self._parts]
        count = len(strain_map.mean)
        self._places = np.linspace(0, count - 1, min(count, _ELSEWHERE_PLACES)).astype(np.intp)

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """See :meth:`.StrainModel.whitened`."""
        return self.noise.whitened(strain)

    def in_volts(self, difference: np.ndarray) -> np.ndarray:
        """See :meth:`.StrainModel.in_volts`."""
        return np.asarray(np.linalg.solve(self.noise.whitening, difference))

    def evaluate(
        self, states: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> Evaluation:
        """See :meth:`.StrainModel.evaluate`."""
        nodes = self.map.nearest(states)
        places = self._places
        rows = np.concatenate([nodes, places])
        plain, inflated = self._densities(rows, strain, used, offset_variance)
        count = len(nodes)
        volume = float(self.noise.log_volume[used].sum())
        position = _mixed(plain[:count]) + volume
        other = _mixed(inflated[:count]) + volume
        elsewhere = float(logsumexp(_mixed(inflated[count:]))) - np.log(len(places)) + volume
        featureless = self._featureless(strain, used, offset_variance) + volume
        return Evaluation(position, position, other, elsewhere, featureless)

    def expected(self, states: np.ndarray, weights: np.ndarray, strain: np.ndarray) -> Expected:
        """See :meth:`.StrainModel.expected`."""
        kept = weights > 1e-6
        nodes, weights = self.map.nearest(states[kept]), weights[kept]
        used = np.ones(self.noise.layout.phalanges, dtype=bool)
        plain, _ = self._densities(nodes, strain, used, np.zeros(len(used)))
        shares = np.exp(plain - np.logaddexp.reduce(plain, axis=1, keepdims=True))
        shares *= (weights / weights.sum())[:, None]
        means = self.map.mean[nodes].reshape(-1, len(strain))
        flat = shares.ravel()
        mean = flat @ means
        spread = np.maximum(flat @ means**2 - mean**2, 0.0)
        noise = flat @ self.map.variance[nodes].reshape(len(flat), -1)
        return Expected(strain - mean, spread, noise)

    def _densities(
        self, rows: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Log-densities (P, K) of a strain at rows of the tables, with priors; and of larger variance."""
        prior = self.map.log_prior[rows]
        plain, inflated = prior.copy(), prior.copy()
        for index, own in enumerate(self.noise.layout.slices):
            if not used[index]:
                continue
            part = strain[own].astype(np.float32)
            # |z - m|^2 by one product with the table instead of differences channel by channel.
            squared = self._squares[index][rows] - 2.0 * (self._parts[index][rows] @ part) + part @ part
            np.maximum(squared, 0.0, out=squared)
            variance = self.map.variance[rows, :, index] + np.float32(offset_variance[index])
            channels = own.stop - own.start
            plain += log_density(squared, variance, channels)
            inflated += log_density(squared, np.float32(INFLATION) * variance, channels)
        return plain, inflated

    def _featureless(self, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray) -> float:
        if self._featureless_variance is None:
            return -np.inf
        layout = self.noise.layout
        squared = layout.sum(strain**2)
        return float(
            sum(
                log_density(squared[f], self._featureless_variance + offset_variance[f], layout.counts[f])
                for f in np.flatnonzero(used)
            )
        )


def _mixed(log_densities: np.ndarray) -> np.ndarray:
    """Logarithms of the sums over components, (P, K) to (P,) float64."""
    if log_densities.shape[1] == 1:
        return log_densities[:, 0].astype(np.float64)
    return np.logaddexp.reduce(log_densities.astype(np.float64), axis=1)
