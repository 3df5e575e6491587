"""Sweep mixture: a place feels as an interpolation between two sweeps on either side of it."""

from __future__ import annotations

from copy import copy

import numpy as np

from tactile_localizer.core.filters.weights import log_mean
from tactile_localizer.core.likelihood.evaluation import Evaluation, Expected
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import log_density

INFLATION = 9.0
"""Factor of the variance under which a strain fits unknown material: three standard deviations. By judgement;
tried on two fabrics and three simulated features."""
_LOG_NEGLIGIBLE = np.log(1e-3)
"""Weight of a state, relative to the largest, below which it does not count in an expectation."""
_FARTHEST = 1e9
"""Noise widths beyond which a strain is as unlike every place as it can be; its square is still a float32."""
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
        # By component and phalanx, each table contiguous: a measurement update runs through them in order.
        self._means = [
            [np.ascontiguousarray(strain_map.mean[:, k, own]) for own in layout.slices]
            for k in range(strain_map.mean.shape[1])
        ]
        self._squares = [[np.einsum("mc,mc->m", part, part) for part in parts] for parts in self._means]
        self._variances = np.ascontiguousarray(np.moveaxis(strain_map.variance, 0, 2))
        self._log_priors = np.ascontiguousarray(strain_map.log_prior.T)
        count = len(strain_map.mean)
        self._places = np.linspace(0, count - 1, min(count, _ELSEWHERE_PLACES)).astype(np.intp)

    def tempered(self, information_length: float) -> SweepMixture:
        """The same tables with another length of information."""
        other = copy(self)
        other.information_length = information_length
        return other

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """See :meth:`.StrainModel.whitened`."""
        return self.noise.whitened(strain).clip(-_FARTHEST, _FARTHEST)

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
        position = _mixed(plain[:, :count]) + volume
        other = _mixed(inflated[:, :count]) + volume
        elsewhere = log_mean(_mixed(inflated[:, count:])) + volume
        featureless = self._featureless(strain, used, offset_variance) + volume
        return Evaluation(position, position, other, elsewhere, featureless)

    def expected(self, states: np.ndarray, log_weights: np.ndarray, strain: np.ndarray) -> Expected:
        """See :meth:`.StrainModel.expected`; by the nearest pair of sweeps of each state."""
        kept = log_weights > log_weights.max() + _LOG_NEGLIGIBLE
        nodes, weights = self.map.nearest(states[kept]), np.exp(log_weights[kept] - log_weights.max())
        weights = (weights / weights.sum()).astype(np.float32)
        means = self.map.mean[nodes, 0]
        mean = weights @ means
        spread = weights @ np.square(means - mean)
        return Expected(strain - mean, spread, weights @ self.map.variance[nodes, 0])

    def _densities(
        self, rows: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Log-densities (K, P) of a strain at rows of the tables, with priors; and of larger variance."""
        plain = self._log_priors.take(rows, axis=1)
        inflated = plain.copy()
        strain = strain.astype(np.float32)
        for index in np.flatnonzero(used):
            own = self.noise.layout.slices[index]
            channels, part = own.stop - own.start, strain[own]
            for k, means in enumerate(self._means):
                # |z - m|^2 by one product with the table instead of differences channel by channel.
                squared = self._squares[k][index].take(rows)
                squared -= 2.0 * (means[index].take(rows, axis=0) @ part) - part @ part
                np.maximum(squared, 0.0, out=squared)
                variance = self._variances[k, index].take(rows) + np.float32(offset_variance[index])
                plain[k] += log_density(squared, variance, channels)
                inflated[k] += log_density(squared, np.float32(INFLATION) * variance, channels)
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
    """Logarithms of the sums over components, (K, P) to (P,) float64."""
    if len(log_densities) == 1:
        return log_densities[0].astype(np.float64)
    largest = log_densities.max(axis=0)
    return (largest + np.log(np.exp(log_densities - largest).sum(axis=0))).astype(np.float64)
