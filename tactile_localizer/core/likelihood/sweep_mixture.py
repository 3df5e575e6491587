"""Sweep mixture: the expected strain is interpolated between pairs of sweeps on either side of a place."""

from __future__ import annotations

import math
from copy import copy
from functools import reduce
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.evaluation import INFLATION, Evaluation, Expected
from tactile_localizer.core.likelihood.new_session import NewSession
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, log_density
from tactile_localizer.core.likelihood.weights import log_sum, normalize

_LOG_NEGLIGIBLE = np.log(1e-3)
"""Weight of a state, relative to the largest, below which it is neglected in an expectation."""
_LOG_INFLATION = np.float32(np.log(INFLATION))
_FARTHEST = 1e9
"""Largest whitened strain, at which others are clipped; its square is still a float32."""
_ELSEWHERE = 400
"""Components that stand for the whole map in the likelihood of a strain that was felt anywhere: the error of
its logarithm is a fifth of a nat on a simulated bump, of which a measurement takes a twentieth."""


class SweepMixture:
    """Student-t mixture over pairs of sweeps on either side of a place, from tables (:class:`.StrainMap`).

    Parameters
    ----------
    noise : noise model, which whitens strains
    strain_map : tables of expected strain and variance
    cell : (d,) size of the grid filter's cells for which the tables were made, m (yaw: rad)
    information_length : m of travel per independent measurement of the position
    correlation_length : integrated autocorrelation of the residual, m
    new_session : model of another session; ``None`` if offsets are observed on featureless places

    Attributes
    ----------
    presence_length : m of travel per independent measurement of whether the hand is on the map
    offset_variance : (C,) whitened variance of a sweep's constant offset
    """

    def __init__(
        self,
        noise: NoiseModel,
        strain_map: StrainMap,
        cell: np.ndarray,
        information_length: float,
        correlation_length: float,
        new_session: NewSession | None,
    ) -> None:
        self.noise, self.map, self.cell = noise, strain_map, cell
        self._correlation_length = correlation_length
        self.offset_variance, self.new_session = noise.offset_variance, new_session
        self._featureless_variance = strain_map.featureless_variance
        self._set_lengths(information_length)
        counts = np.array(noise.layout.counts, dtype=np.float32)
        self._tails = np.float32(DEGREES_OF_FREEDOM) + counts
        # Rows by which a product with strains sums over the channels of each phalanx.
        self._phalanges = noise.layout.expand(np.eye(len(counts), dtype=np.float32))
        _, self._components, channels = strain_map.mean.shape
        mean = strain_map.mean.reshape(-1, channels)
        self._tables = _Rows(
            mean,
            np.stack([np.einsum("nc,nc->n", own, own) for own in noise.layout.split(mean)])
            / np.float32(DEGREES_OF_FREEDOM),
            np.ascontiguousarray(strain_map.variance.reshape(len(mean), -1).T),
            strain_map.log_prior.ravel(),
        )
        self._elsewhere, self._elsewhere_prior = _sample(self._tables.log_prior, _ELSEWHERE)
        self._each = np.arange(self._components)[:, None]

    def tempered(self, information_length: float) -> SweepMixture:
        """The same tables with another length of information."""
        other = copy(self)
        other._set_lengths(information_length)
        return other

    def _set_lengths(self, information_length: float) -> None:
        # Errors of the map are common to all places, so presence is measured once per correlation length.
        self.presence_length = max(information_length, self._correlation_length)
        # On textured material a belief that follows each strain would fit other material too.
        is_felt_everywhere = self._featureless_variance is None
        self.information_length = self.presence_length if is_felt_everywhere else information_length

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """A strain vector (C,), V, in whitened coordinates."""
        return self.noise.whitened(strain).clip(-_FARTHEST, _FARTHEST)

    def in_volts(self, difference: np.ndarray) -> np.ndarray:
        """A difference (C,) of whitened strains in V."""
        return np.asarray(np.linalg.solve(self.noise.whitening, difference))

    def evaluate(
        self, states: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> Evaluation:
        """Log-likelihoods of a whitened strain (C,) at ``states`` (P, d) and under the alternatives.

        Parameters
        ----------
        used : (F,) bool, phalanges that count
        offset_variance : (F,) whitened variance of the remaining uncertainty of the sweep's offset
        """
        nodes = self.map.nearest(states)
        components = (self._components * nodes + self._each).ravel()
        rows = self._tables.take(np.concatenate([self._elsewhere, components]))
        plain, wide = self._densities(rows, strain, used, offset_variance)
        volume = float(self.noise.log_volume[used].sum())
        first, by_component = len(self._elsewhere), (self._components, len(nodes))
        # Unknown material feels like any place of the map, or less like it, both alike.
        anywhere = np.concatenate([plain[:first], wide[:first]]).reshape(2, -1) + self._elsewhere_prior
        elsewhere = log_sum(anywhere.ravel()) - math.log(2.0) + volume
        plain, wide = (each[first:] + rows.log_prior[first:] for each in (plain, wide))
        position = _mixed(plain.reshape(by_component)) + volume
        other = _mixed(wide.reshape(by_component)) + volume
        featureless = self._featureless(strain, used, offset_variance) + volume
        return Evaluation(position, position, other, elsewhere, featureless, nodes)

    def expected(self, nodes: np.ndarray, log_weights: np.ndarray, strain: np.ndarray) -> Expected:
        """Comparison of a whitened strain (C,) with that expected under ``log_weights`` of ``nodes`` (P,)."""
        log_weights = log_weights - log_weights.max()
        kept = (log_weights > _LOG_NEGLIGIBLE).nonzero()[0]
        rows, weights = self._components * nodes[kept], np.exp(log_weights[kept])
        weights = (weights / weights.sum()).astype(np.float32)
        means = self._tables.mean.take(rows, axis=0)
        mean = weights @ means
        means -= mean
        spread = weights @ np.square(means, out=means)
        return Expected(strain - mean, spread, self._tables.variance.take(rows, axis=1) @ weights)

    def _densities(
        self, rows: _Rows, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Log-densities (N,) of a strain at each component, with its variance and with a larger one."""
        strain = strain.astype(np.float32)
        own = self._phalanges * (strain / np.float32(DEGREES_OF_FREEDOM))
        # |z - m|^2 by one product with the table instead of differences channel by channel.
        squared = (np.float32(-2.0) * own) @ rows.mean.T
        squared += rows.squares
        squared += (own @ strain)[:, None]
        np.maximum(squared, 0.0, out=squared)
        variance = rows.variance + offset_variance.astype(np.float32)[:, None]
        tails = np.float32(-0.5) * self._tails * used
        heads = np.float32(0.5 * DEGREES_OF_FREEDOM) * used.astype(np.float32)
        broad = np.float32(INFLATION) * variance
        broad += squared
        squared += variance
        common = heads @ np.log(variance, out=variance)
        plain = tails @ np.log(squared, out=squared)
        plain += common
        wide = tails @ np.log(broad, out=broad)
        wide += common
        wide += heads.sum() * _LOG_INFLATION
        return plain, wide

    def _featureless(self, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray) -> float:
        if self._featureless_variance is None:
            return -np.inf
        layout = self.noise.layout
        variance = self._featureless_variance + offset_variance
        squared = layout.sum((strain - self.map.featureless) ** 2)
        densities = log_density(squared, variance, layout.widths)[:, used].sum(axis=1)
        # The best yaw, not the mean: the map is at the right yaw too, and would gain 2 nats per measurement.
        return float(densities.max())


class _Rows(NamedTuple):
    """Tables for N components, those of a place one after another, best first.

    A phalanx at a time, because arrays with a short last axis take several times longer.

    Parameters
    ----------
    mean : (N, C)
    squares : (F, N) squared length of each phalanx's mean, in degrees of freedom
    variance : (F, N)
    log_prior : (N,)
    """

    mean: np.ndarray
    squares: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray

    def take(self, rows: np.ndarray) -> _Rows:
        """Some of the components, by index."""
        mean, squares, variance, log_prior = self
        return _Rows(
            mean.take(rows, axis=0),
            squares.take(rows, axis=1),
            variance.take(rows, axis=1),
            log_prior.take(rows),
        )


def _sample(log_weights: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Some of the weighted entries (N,) that stand for all of them: index, and logarithms of weights.

    Each is chosen as often as it is probable, evenly over their order; few enough entries are all chosen.
    """
    if len(log_weights) <= most:
        return np.arange(len(log_weights)), normalize(log_weights.astype(np.float64))[0]
    cumulated = np.cumsum(np.exp(log_weights, dtype=np.float64))
    index = np.searchsorted(cumulated, cumulated[-1] / most * (np.arange(most) + 0.5))
    return index, np.full(most, -np.log(most))


def _mixed(log_densities: np.ndarray) -> np.ndarray:
    """Logarithms of the sums over components, (K, P) to (P,) float64."""
    if len(log_densities) == 1:
        return log_densities[0].astype(np.float64)
    largest = reduce(np.maximum, log_densities)
    scaled = log_densities - largest
    largest += np.log(np.exp(scaled, out=scaled).sum(axis=0))
    return largest.astype(np.float64)
