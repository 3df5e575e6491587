"""Sweep mixture: a place feels as an interpolation between two sweeps on either side of it."""

from __future__ import annotations

from copy import copy
from functools import reduce
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.evaluation import INFLATION, Evaluation, Expected
from tactile_localizer.core.likelihood.new_session import NewSession
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, log_density
from tactile_localizer.core.likelihood.weights import log_mean

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
    new_session : how strains differ in another session; ``None`` where featureless places show an offset
    """

    def __init__(
        self,
        noise: NoiseModel,
        strain_map: StrainMap,
        cell: np.ndarray,
        information_length: float,
        presence_length: float,
        new_session: NewSession | None,
    ) -> None:
        self.noise, self.map, self.cell = noise, strain_map, cell
        self.information_length, self.presence_length = information_length, presence_length
        self.offset_variance, self.new_session = noise.offset_variance, new_session
        self._featureless_variance = strain_map.featureless_variance
        counts = np.array(noise.layout.counts, dtype=np.float32)
        self._tails = np.float32(DEGREES_OF_FREEDOM) + counts
        # Columns by which a product with strains sums over the channels of each phalanx.
        self._phalanges = noise.layout.expand(np.eye(len(counts), dtype=np.float32)).T
        count, self._components, channels = strain_map.mean.shape
        squares = np.square(strain_map.mean.reshape(-1, channels)) @ self._phalanges
        self._tables = _Rows(
            strain_map.mean,
            squares.reshape(count, self._components, -1),
            strain_map.variance,
            strain_map.log_prior,
        )
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
        rows = self._tables.take(np.concatenate([nodes, self._places]))
        count = len(nodes)
        plain, inflated = self._densities(rows, count, strain, used, offset_variance)
        volume = float(self.noise.log_volume[used].sum())
        position = _mixed(plain) + volume
        wide = _mixed(inflated) + volume
        other, elsewhere = wide[:count], log_mean(wide[count:])
        featureless = self._featureless(strain, used, offset_variance) + volume
        return Evaluation(position, position, other, elsewhere, featureless, nodes)

    def expected(self, nodes: np.ndarray, log_weights: np.ndarray, strain: np.ndarray) -> Expected:
        """See :meth:`.StrainModel.expected`; by the nearest pair of sweeps of each state."""
        kept = log_weights > log_weights.max() + _LOG_NEGLIGIBLE
        nodes, weights = nodes[kept], np.exp(log_weights[kept] - log_weights.max())
        weights = (weights / weights.sum()).astype(np.float32)
        means = self.map.mean[nodes, 0]
        mean = weights @ means
        spread = weights @ np.square(means - mean)
        return Expected(strain - mean, spread, weights @ self.map.variance[nodes, 0])

    def _densities(
        self, rows: _Rows, count: int, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Log-densities (P, K) of a strain with priors: of the first ``count`` places, wider of all."""
        strain = strain.astype(np.float32)
        columns = self._phalanges * strain[:, None]
        # |z - m|^2 by one product with the table instead of differences channel by channel.
        squared = rows.squares - 2.0 * (rows.mean @ columns)
        squared += strain @ columns
        np.maximum(squared, 0.0, out=squared)
        squared *= np.float32(1.0 / DEGREES_OF_FREEDOM)
        variance = rows.variance + offset_variance.astype(np.float32)
        tails = np.float32(-0.5) * self._tails * used
        heads = np.float32(0.5 * DEGREES_OF_FREEDOM) * used.astype(np.float32)
        wide = np.float32(INFLATION) * variance
        wide += squared
        first = count * self._components
        narrow = squared[:first] + variance[:first]
        common = np.log(variance, out=variance) @ heads
        common += rows.log_prior
        plain = np.log(narrow, out=narrow) @ tails
        plain += common[:first]
        inflated = np.log(wide, out=wide) @ tails
        inflated += common
        inflated += heads.sum() * np.float32(np.log(INFLATION))
        return plain.reshape(-1, self._components), inflated.reshape(-1, self._components)

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


class _Rows(NamedTuple):
    """Tables for P places with K components each, or their rows (P K) one below the other.

    Parameters
    ----------
    mean : (P, K, C)
    squares : (P, K, F) squared length of each phalanx's mean
    variance : (P, K, F)
    log_prior : (P, K)
    """

    mean: np.ndarray
    squares: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray

    def take(self, rows: np.ndarray) -> _Rows:
        """Some of the places, by index, with a row for each of their components."""
        mean, squares, variance, log_prior = (table.take(rows, axis=0) for table in self)
        flat = [part.reshape(-1, part.shape[-1]) for part in (mean, squares, variance)]
        return _Rows(flat[0], flat[1], flat[2], log_prior.ravel())


def _mixed(log_densities: np.ndarray) -> np.ndarray:
    """Logarithms of the sums over components, (P, K) to (P,) float64."""
    components = log_densities.T
    largest = reduce(np.maximum, components)
    if len(components) == 1:
        return largest.astype(np.float64)
    scaled = log_densities - largest[:, None]
    total = np.exp(scaled, out=scaled) @ np.ones(len(components), dtype=np.float32)
    return (largest + np.log(total)).astype(np.float64)
