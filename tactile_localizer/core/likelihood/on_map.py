"""Likelihoods of a strain at places of the map: Student-t mixtures over the components of their nodes.

By the compiled twins (:mod:`..compiled`), where they were built, and by numpy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core import compiled
from tactile_localizer.core.likelihood.drift import OUTLIER
from tactile_localizer.core.likelihood.gain import Gain
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, log_density, mahalanobis, weight

_ALIKE = 0.3
"""Difference of two components, in noise widths of a visit, below which they are one. It saves time."""
_FITS = 1e-3
"""Weight of a place, in that of the likeliest, from which its residual counts. It saves time."""
_MEAN_SQUARE = DEGREES_OF_FREEDOM / (DEGREES_OF_FREEDOM - 2.0)
"""Variance of the t-distribution, in that of its scale."""
_LARGEST_LOG_RATIO = 700.0
"""Of the densities of two components, nats: its exponential is a float64."""


class Components(NamedTuple):
    """The components of M nodes: the first of each, and n others, those of one node after those of another.

    Parameters
    ----------
    mean : (M, C) float32, whitened strain of the first component
    spread : (F + 1, M) float32, variances of a new visit about it, and the logarithm of its prior
    counts, starts : (M,) int, number of a node's other components, and the first of them
    away : (n, C) float32, mean of the other components less that of the first
    other_spread : (F + 1, n) float32, as ``spread``
    """

    mean: np.ndarray
    spread: np.ndarray
    counts: np.ndarray
    starts: np.ndarray
    away: np.ndarray
    other_spread: np.ndarray

    @classmethod
    def distinct(cls, strain_map: StrainMap, layout: ChannelLayout) -> Components:
        """The components of each node that differ from its first, into which the others are averaged.

        At most nodes no phalanx touches a feature, and all components are alike.
        """
        mean, variance, log_prior = (
            each.copy() for each in (strain_map.mean, strain_map.variance, strain_map.log_prior)
        )
        alike = (np.square(mean - mean[:, :1]) @ _rows(layout).T < _ALIKE**2).all(axis=2)
        share = np.exp(log_prior) * alike
        first = share.sum(axis=1)
        share /= first[:, None]
        mean[:, 0] = np.einsum("mk,mkc->mc", share, mean)
        variance[:, 0] = np.einsum("mk,mkf->mf", share, variance)
        log_prior[:, 0] = np.log(first)
        other, spread = ~alike, np.concatenate([variance, log_prior[..., None]], axis=2)
        counts = other.sum(axis=1)
        return cls(
            mean[:, 0].copy(),
            spread[:, 0].T.copy(),
            counts,
            counts.cumsum() - counts,
            (mean - mean[:, :1])[other],
            spread[other].T.copy(),
        )


class Felt(NamedTuple):
    """A strain that is compared with the map.

    Parameters
    ----------
    strain : (C,) float32, its innovation, whitened
    transform : (C, C) float32: ``of_map @ transform`` is whitened as the strain is; it is an upper triangle,
        of a sheet one for each phalanx. ``None``: the map is whitened alike
    level_variance : (F,) float32, of its level
    used : (F,) bool, phalanges that count
    """

    strain: np.ndarray
    transform: np.ndarray | None
    level_variance: np.ndarray
    used: np.ndarray


class Places(NamedTuple):
    """N places, of which the first P are states and the others anchors.

    Parameters
    ----------
    nodes : (N,) of the map, nearest to the places
    states : their number P
    of_map : (N, C) float32, innovation of the first component there
    gain : of the sweep's signal along the trajectories to these places
    """

    nodes: np.ndarray
    states: int
    of_map: np.ndarray
    gain: Gain


class OnMap(NamedTuple):
    """Likelihoods of a strain at N places of the map: P states, then R anchors.

    Parameters
    ----------
    states, anchors : (P,) and (R,) log-likelihoods
    gain : after the strain; that of an outlier counts as by the weights of the t-distribution
    """

    states: np.ndarray
    anchors: np.ndarray
    gain: Gain


class _Residuals(NamedTuple):
    """Residuals of a strain at N places: from n components other than the first, then from the N first ones.

    Parameters
    ----------
    place : (n,) int, place of each of the others
    squared : (F, n + N) float32, squared residual at the mean gain
    product, energy : (F, n + N) float32, of the signal with the residual, and its squared length
    projected, along : (F, n + N) float32, square of the product, and energy, times the variance of the gain
    variance : (F, n + N) float32, of a visit
    log_prior : (n + N,) float32, of the components
    """

    place: np.ndarray
    squared: np.ndarray
    product: np.ndarray
    energy: np.ndarray
    projected: np.ndarray
    along: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray

    def first(self, values: np.ndarray) -> np.ndarray:
        """Those of ``values`` (F, n + N) that belong to the first components, (F, N)."""
        return values[:, len(self.place) :]

    def likelihoods(self, channels: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log-likelihoods (N,) of the phalanges ``used`` (F,) bool.

        And the squared Mahalanobis lengths (F, n + N) of the residuals.
        """
        variance, total = self.variance, self.variance + self.along
        lengths = mahalanobis(self.squared, variance, self.projected, total)
        plain = log_density(lengths, variance, total, channels) + self.log_prior
        first, place = self.first(plain).astype(np.float64), self.place
        if len(place):
            # Relative to the first component, which is faster than to the largest of each place.
            ratios = plain[:, : len(place)] - first.take(place, axis=1)
            ratios = np.exp(np.minimum(ratios, _LARGEST_LOG_RATIO))
            sums = np.array([np.bincount(place, each) for each in ratios])
            first[:, : sums.shape[1]] += np.log(1.0 + sums)
        return np.asarray(used @ first), lengths


class MapLikelihood:
    """Likelihoods of strains at places of the map.

    Parameters
    ----------
    strain_map : tables of expected strain and variance
    layout : of the channels
    """

    def __init__(self, strain_map: StrainMap, layout: ChannelLayout) -> None:
        self._map, self._components = strain_map, Components.distinct(strain_map, layout)
        self._shape = np.array(strain_map.shape, dtype=np.intp)
        self._channels = np.array(layout.counts, dtype=np.float32)[:, None]
        self._layout = layout
        self._rows = _rows(layout)

    def expected(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (N,) nearest to places (N, d), and the whitened strain there (N, C), first component."""
        lattice, table = self._map, self._components.mean
        if compiled.MODULE is None:
            nodes = lattice.nearest(places)
            return nodes, table.take(nodes, axis=0)
        nodes, strain = (
            np.empty(len(places), dtype=np.intp),
            np.empty((len(places), table.shape[1]), np.float32),
        )
        by_axis = np.ascontiguousarray(places.T)
        compiled.MODULE.map_at(by_axis, lattice.origin, lattice.step, self._shape, table, nodes, strain)
        return nodes, strain

    def of(self, felt: Felt, places: Places, exponent: float) -> OnMap:
        """Likelihoods of a strain at places of the map, and the gain after this fraction of a measurement."""
        compute = self._by_numpy if compiled.MODULE is None else self._compiled
        return compute(felt, places, exponent)

    def _compiled(self, felt: Felt, places: Places, exponent: float) -> OnMap:
        assert compiled.MODULE is not None
        nodes, states, of_map, gain = places
        likelihoods, after = np.empty(len(nodes)), np.empty_like(gain.moments)
        there = nodes, of_map, gain.moments, self._layout.bounds
        found = DEGREES_OF_FREEDOM, exponent, states, likelihoods, after
        compiled.MODULE.on_map(*self._components[1:], *there, *felt, *found)
        return OnMap(likelihoods[:states], likelihoods[states:], Gain(after))

    def _by_numpy(self, felt: Felt, places: Places, exponent: float) -> OnMap:
        states, residuals = places.states, self._residuals(felt, places)
        likelihoods, lengths = residuals.likelihoods(self._channels, felt.used)
        counted = weight(residuals.first(lengths), self._channels) / residuals.first(residuals.variance)
        information, product = (
            counted * residuals.first(each) for each in (residuals.energy, residuals.product)
        )
        after = places.gain.updated(information, product, exponent)
        return OnMap(likelihoods[:states], likelihoods[states:], after)

    def moments(self, felt: Felt, places: Places, weights: np.ndarray) -> np.ndarray:
        """Second moments (C, C) of the residuals from the first components, a block per phalanx.

        In the variance of a visit, averaged with the ``weights`` (P,) of the states; those of an outlier are
        bounded.
        """
        of_map, spread = places.of_map, self._components.spread
        least = _FITS * float(weights.max())
        if compiled.MODULE is not None:
            found = np.empty((of_map.shape[1],) * 2)
            there = places.nodes, of_map, places.gain.moments, self._layout.bounds
            compiled.MODULE.scatter(spread, *there, *felt[:3], weights, least, OUTLIER, found)
            return found / _MEAN_SQUARE
        if felt.transform is not None:
            of_map = of_map @ felt.transform
        fits = np.flatnonzero(weights > least)
        variance = (spread[:-1].take(places.nodes[fits], axis=1) + felt.level_variance[:, None]).T
        gain = places.gain.mean.take(fits, axis=1).T.astype(np.float64) @ self._rows
        residuals = felt.strain - gain * of_map.take(fits, axis=0)
        squared = np.square(residuals) @ self._rows.T / (variance * self._channels.T)
        counted = np.minimum(OUTLIER / np.maximum(squared, OUTLIER), 1.0) * (weights[fits, None] / variance)
        found = np.zeros((of_map.shape[1],) * 2)
        for phalanx, own in enumerate(self._layout.slices):
            found[own, own] = (residuals[:, own].T * counted[:, phalanx]) @ residuals[:, own]
        return found / _MEAN_SQUARE

    def _residuals(self, felt: Felt, places: Places) -> _Residuals:
        """Residuals of a strain from the components at states and anchors."""
        nodes, states, of_map, gain = places
        components, signal, of_strain, (mean, spread) = self._components, of_map, felt.strain, gain.moments
        table = components.spread.take(nodes, axis=1)
        table[-1, states:] = 0.0  # anchors: the first component alone
        counts = components.counts.take(nodes[:states])
        place = np.arange(states).repeat(counts)
        if len(place):
            before = components.starts.take(nodes[:states]) - (counts.cumsum() - counts)
            rows = np.arange(len(place)) + before.take(place)
            others = signal.take(place, axis=0)
            others += components.away.take(rows, axis=0)
            signal = np.concatenate([others, signal])
            table = np.concatenate([components.other_spread.take(rows, axis=1), table], axis=1)
            mean, spread = (np.concatenate([each.take(place, axis=1), each], axis=1) for each in gain.moments)
        variance, log_prior = table[:-1], table[-1]
        if felt.transform is not None:
            signal = signal @ felt.transform
        variance += felt.level_variance[:, None]
        residual = of_strain - signal
        energy = self._rows @ np.square(signal).T
        product = (self._rows * of_strain) @ signal.T - energy
        # From the residual of a gain of one to that of the mean gain.
        more = 1.0 - mean
        squared = self._rows @ np.square(residual, out=residual).T + more * (2.0 * product + more * energy)
        product += more * energy
        projected, along = spread * np.square(product), spread * energy
        return _Residuals(place, squared, product, energy, projected, along, variance, log_prior)


def _rows(layout: ChannelLayout) -> np.ndarray:
    """(F, C) float32: a product with them sums over the channels of each phalanx."""
    return layout.expand(np.eye(layout.phalanges, dtype=np.float32))
