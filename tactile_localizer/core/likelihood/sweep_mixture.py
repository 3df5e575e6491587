"""Sweep mixture: what a phalanx feels at a place is an interpolation between two sweeps around it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.evaluation import INFLATION, Evaluation, Expected
from tactile_localizer.core.likelihood.new_session import NewSession
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, log_density
from tactile_localizer.core.likelihood.weights import log_sum

_LOG_NEGLIGIBLE = np.log(1e-3)
"""Weight of a state, relative to the largest, below which it is neglected in an expectation."""
_LOG_INFLATION = np.float32(np.log(INFLATION))
_FARTHEST = 1e9
"""Largest whitened strain, at which others are clipped; its square is still a float32."""
_ELSEWHERE = 400
"""Places that represent the whole map in the density of a strain anywhere on it: its logarithm is off by
1.1 nats (root mean square) on a simulated bump, of which a measurement takes a tenth."""


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
        nodes, self._components, _ = strain_map.mean.shape
        self._tables = _Tables.of(strain_map, noise.layout)
        self._sample = self._tables.sampled(nodes, self._components, noise.layout)
        self._each = np.arange(self._components)[:, None]

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
        rows = self._tables.after(self._sample, components)
        first = len(self._sample.mean)
        # With a larger variance the components of a place hardly differ: the best one is enough.
        plain, wide = self._densities(rows, strain, used, offset_variance, first + len(nodes))
        volume = float(self.noise.log_volume[used].sum())
        by_component = (len(used), self._components, len(nodes))
        # Unknown material feels like any place of the map, or less like it, both alike.
        anywhere = np.concatenate([plain[:, :first], wide[:, :first]], axis=1).sum(axis=0)
        elsewhere = log_sum(anywhere) - math.log(2.0 * first) + volume
        log_prior = rows.log_prior[:, first:]
        position = _mixed((plain[:, first:] + log_prior).reshape(by_component)).sum(axis=0) + volume
        other = wide[:, first:].sum(axis=0).astype(np.float64) + volume
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
        self, rows: _Tables, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray, end: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Log-densities (F, N) of a strain at each component; (F, end) with a larger variance."""
        strain = strain.astype(np.float32)
        own = self._phalanges * (strain / np.float32(DEGREES_OF_FREEDOM))
        # |z - m|^2 by one product with the table instead of differences channel by channel.
        squared = (np.float32(-2.0) * own) @ rows.mean.T
        squared += rows.squares
        squared += (own @ strain)[:, None]
        np.maximum(squared, 0.0, out=squared)
        variance = rows.variance + offset_variance.astype(np.float32)[:, None]
        tails = (np.float32(-0.5) * self._tails * used)[:, None]
        heads = (np.float32(0.5 * DEGREES_OF_FREEDOM) * used.astype(np.float32))[:, None]
        broad = np.float32(INFLATION) * variance[:, :end]
        broad += squared[:, :end]
        squared += variance
        common = np.log(variance, out=variance)
        common *= heads
        plain = np.log(squared, out=squared)
        plain *= tails
        plain += common
        wide = np.log(broad, out=broad)
        wide *= tails
        wide += common[:, :end]
        wide += heads * _LOG_INFLATION
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


class _Tables(NamedTuple):
    """Tables for N components, those of a place one after another, best first.

    A phalanx at a time, because arrays with a short last axis take several times longer.

    Parameters
    ----------
    mean : (N, C)
    squares : (F, N) squared length of each phalanx's mean, in degrees of freedom
    variance : (F, N)
    log_prior : (1, N)
    """

    mean: np.ndarray
    squares: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray

    @classmethod
    def of(cls, strain_map: StrainMap, layout: ChannelLayout) -> _Tables:
        """The tables of a map, by component."""
        mean = strain_map.mean.reshape(-1, layout.size)
        squares = [np.einsum("nc,nc->n", own, own) for own in layout.split(mean)]
        variance, log_prior = (
            np.ascontiguousarray(table.reshape(len(mean), -1).T)
            for table in (strain_map.variance, strain_map.log_prior)
        )
        return cls(mean, np.stack(squares) / np.float32(DEGREES_OF_FREEDOM), variance, log_prior)

    def take(self, rows: np.ndarray) -> _Tables:
        """Some of the components, by index."""
        mean, squares, variance, log_prior = self
        return _Tables(
            mean.take(rows, axis=0),
            squares.take(rows, axis=1),
            variance.take(rows, axis=1),
            log_prior.take(rows, axis=1),
        )

    def after(self, others: _Tables, rows: np.ndarray) -> _Tables:
        """The others, and then some of these components, by index."""
        count, first = len(rows), len(others.mean)
        mean = np.empty((first + count, self.mean.shape[1]), dtype=np.float32)
        mean[:first] = others.mean
        self.mean.take(rows, axis=0, out=mean[first:], mode="clip")
        found = [mean]
        for table, other in zip(self[1:], others[1:], strict=True):
            joined = np.empty((len(table), first + count), dtype=np.float32)
            joined[:, :first] = other
            for source, target in zip(table, joined, strict=True):
                source.take(rows, out=target[first:], mode="clip")
            found.append(joined)
        return _Tables(*found)

    def sampled(self, nodes: int, components: int, layout: ChannelLayout) -> _Tables:
        """Equally probable components of places over all the map, each phalanx's drawn independently."""
        count = min(nodes, _ELSEWHERE) if components == 1 else _ELSEWHERE
        places = np.arange(count) * nodes // count
        quantile = np.random.default_rng(0).random((layout.phalanges, 1, len(places)))
        cumulated = np.exp(self.log_prior.reshape(nodes, components)[places]).cumsum(axis=1).T
        drawn = (cumulated < quantile).sum(axis=1).clip(max=components - 1)
        rows = components * places + drawn
        by_phalanx = [self.take(own) for own in rows]
        mean = np.concatenate(
            [own.mean[:, channels] for own, channels in zip(by_phalanx, layout.slices, strict=True)], axis=1
        )
        squares, variance = (
            np.stack([own[field][f] for f, own in enumerate(by_phalanx)]) for field in (1, 2)
        )
        return _Tables(mean, squares, variance, np.zeros((1, len(places)), dtype=np.float32))


def _mixed(log_densities: np.ndarray) -> np.ndarray:
    """Logarithms of the sums over components, (F, K, P) to (F, P) float64."""
    if log_densities.shape[1] == 1:
        return log_densities[:, 0].astype(np.float64)
    largest = log_densities.max(axis=1)
    log_densities -= largest[:, None]
    largest += np.log(np.exp(log_densities, out=log_densities).sum(axis=1))
    return largest.astype(np.float64)
