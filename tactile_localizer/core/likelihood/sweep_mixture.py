"""Sweep mixture: what a phalanx feels at a place is an interpolation between two sweeps around it."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.drift import Drift, Innovation, Trend
from tactile_localizer.core.likelihood.gain import LEAST_VARIANCE, Gain
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.other_material import OtherMaterial
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, log_density, mahalanobis, weight

_ALIKE = 0.3
"""Difference of two components, in noise widths of a visit, below which they are one. It saves time."""
_MEAN_SQUARE = DEGREES_OF_FREEDOM / (DEGREES_OF_FREEDOM - 2.0)
"""Variance of the t-distribution, in that of its scale."""
_LARGEST_STRAIN = 1e9
"""Largest whitened strain, at which others are clipped; its square is still a float32."""
_LARGEST_LOG_RATIO = 700.0
"""Of the densities of two components, nats: its exponential is a float64."""


class _Components(NamedTuple):
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

    def likelihoods(
        self, variance: np.ndarray, channels: np.ndarray, used: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Log-likelihoods (N,) of the phalanges ``used`` (F,) bool, with ``variance`` (F, n + N) of a visit.

        And the squared Mahalanobis lengths (F, n + N) of the residuals.
        """
        total = variance + self.along
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


class OnMap(NamedTuple):
    """Likelihoods of a strain at N places of the map: P states, then R anchors.

    Parameters
    ----------
    states, anchors : (P,) and (R,) log-likelihoods under the variance of a visit in the scan
    position : (P,) log-likelihoods under the variance of the sweep at hand
    squared : (F, P) squared residuals, in those expected in the scan
    information, product : (F, N) squared signal, and its product with the residual, over the variance; those
        of an outlier count as by the weights of the t-distribution
    """

    states: np.ndarray
    anchors: np.ndarray
    position: np.ndarray
    squared: np.ndarray
    information: np.ndarray
    product: np.ndarray


class SweepMixture:
    """Student-t mixture over pairs of sweeps on either side of a place, from tables (:class:`.StrainMap`).

    Parameters
    ----------
    noise : noise model, which whitens strains
    strain_map : tables of expected strain and variance
    drift : filter of what a sweep differs by
    other : material that was not scanned
    material : from a sheet to cloth

    Attributes
    ----------
    excess : (C,) V^2, by which the strains of the sweep have more noise than the scan's
    """

    def __init__(
        self,
        noise: NoiseModel,
        strain_map: StrainMap,
        drift: Drift,
        other: OtherMaterial,
        material: Material,
    ) -> None:
        self.noise, self.map, self.drift, self.other = noise, strain_map, drift, other
        self.material = material
        layout = noise.layout
        self._channels = np.array(layout.counts, dtype=np.float32)[:, None]
        # A product with these rows sums over the channels of each phalanx.
        self._sums = layout.expand(np.eye(layout.phalanges, dtype=np.float32))
        self._components = self._distinct(strain_map)
        self.gain_variance = max(strain_map.gain, LEAST_VARIANCE)
        self._turns = bool(strain_map.turning.any())
        self.excess = np.zeros(len(noise.centre))
        self._transform: np.ndarray | None = None

    def _distinct(self, strain_map: StrainMap) -> _Components:
        """The components of each node that differ from its first, into which the others are averaged.

        At most nodes no phalanx touches a feature, and all components are alike.
        """
        mean, variance, log_prior = (
            each.copy() for each in (strain_map.mean, strain_map.variance, strain_map.log_prior)
        )
        alike = (np.square(mean - mean[:, :1]) @ self._sums.T < _ALIKE**2).all(axis=2)
        share = np.exp(log_prior) * alike
        first = share.sum(axis=1)
        share /= first[:, None]
        mean[:, 0] = np.einsum("mk,mkc->mc", share, mean)
        variance[:, 0] = np.einsum("mk,mkf->mf", share, variance)
        log_prior[:, 0] = np.log(first)
        other, spread = ~alike, np.concatenate([variance, log_prior[..., None]], axis=2)
        counts = other.sum(axis=1)
        return _Components(
            mean[:, 0].copy(),
            spread[:, 0].T.copy(),
            counts,
            counts.cumsum() - counts,
            (mean - mean[:, :1])[other],
            spread[other].T.copy(),
        )

    def with_noise(self, excess: np.ndarray) -> SweepMixture:
        """The model of a sweep whose strains have more noise than the scan's, by ``excess`` (C,), V^2.

        It shares the tables: residuals are whitened anew when they are evaluated.
        """
        model = copy.copy(self)
        transform = self.noise.rewhitening(excess)
        volume = [np.log(np.diag(transform)[own]).sum() for own in self.noise.layout.slices]
        model.noise = replace(self.noise, log_volume=self.noise.log_volume + np.array(volume))
        model.excess = excess
        model._transform, model.other = transform.astype(np.float32), self.other.transformed(transform)
        return model

    def innovation(
        self,
        trend: Trend,
        strain: np.ndarray,
        places: np.ndarray,
        map_strain: np.ndarray,
        weights: np.ndarray,
        travel: float,
        exponent: float,
    ) -> tuple[Innovation, Trend]:
        """Innovation of a strain (C,), V, at places (N, d) where the map has ``map_strain`` (N, W), whitened.

        See :meth:`.Drift.update`. ``weights`` (P,) are those of the first places, the states.

        What a sweep differs by is the same at every yaw, while the strain of featureless material turns with
        the hand. So the trend is that of the strain less the one at the mean yaw, whose variance counts as
        noise. With a trend for each yaw a turned hand's yaw was 2.7 instead of 0.8 degrees off, because at
        contact the yaw at which a phalanx deformed alike was preferred.
        """
        whitened, turning = self.whitened(strain), self.map.turning
        if not self._turns:
            return self.drift.update(trend, whitened, map_strain, travel, exponent)
        states = places[: len(weights)]
        mean = weights @ states
        noise = (weights @ (states - mean) ** 2) @ turning**2
        known = exponent / (1.0 + noise / self.drift.variance)
        innovation, trend = self.drift.update(trend, whitened - mean @ turning, map_strain, travel, known)
        turned = ((places - mean) @ turning).astype(np.float32)
        of_map = innovation.of_map + turned
        return innovation._replace(of_map=of_map, turned=mean @ turning), trend

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """A strain vector (C,), V, in whitened coordinates."""
        whitened = self.noise.whitened(strain)
        return np.minimum(np.maximum(whitened, -_LARGEST_STRAIN), _LARGEST_STRAIN)

    def in_volts(self, strain: np.ndarray, whitened: np.ndarray) -> np.ndarray:
        """A strain vector (C,), V, moved to where it is ``whitened`` (W,)."""
        return strain + self.noise.inverse @ (whitened - self.noise.whitened(strain))

    def map_at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (N,) nearest to places (N, d), and the whitened strain there (N, C), first component."""
        nodes = self.map.nearest(places)
        return nodes, self._components.mean.take(nodes, axis=0)

    def off_map(self, innovation: Innovation) -> tuple[np.ndarray, np.ndarray]:
        """Innovation (C,) of a strain from featureless material, and the variance (F,) of its level."""
        of_strain = innovation.of_strain
        if self._transform is not None:
            of_strain = self._transform @ of_strain
        return of_strain, self.noise.layout.mean(innovation.level_variance)

    def on_map(
        self,
        nodes: np.ndarray,
        states: int,
        innovation: Innovation,
        gain: Gain,
        scale: np.ndarray,
        used: np.ndarray,
    ) -> OnMap:
        """Likelihoods of a strain at N places, of which the first P are states and the others anchors.

        Parameters
        ----------
        nodes : (N,) of the map, nearest to the places
        states : their number P
        innovation : of the strain, and of the map at these N places
        gain : of the sweep's signal along the trajectories to these N places
        scale : (F,) of the squared residuals of the sweep, in those of the scan
        used : (F,) bool, phalanges that count
        """
        felt = self._residuals(nodes, states, innovation, gain)
        variance, channels = felt.variance, self._channels
        likelihoods, lengths = felt.likelihoods(variance, channels, used)
        at_states = position = likelihoods[:states]
        squared = felt.first(lengths)[:, :states] / (_MEAN_SQUARE * channels)
        if (scale > 1.0).any():
            variance = variance * np.maximum(scale, 1.0).astype(np.float32)[:, None]
            in_sweep, lengths = felt.likelihoods(variance, channels, used)
            position = in_sweep[:states]
        counted = weight(felt.first(lengths), channels) / felt.first(variance)
        information, product = counted * felt.first(felt.energy), counted * felt.first(felt.product)
        return OnMap(at_states, likelihoods[states:], position, squared, information, product)

    def _residuals(self, nodes: np.ndarray, states: int, innovation: Innovation, gain: Gain) -> _Residuals:
        """Residuals of a strain from the components at states and anchors; see :meth:`on_map`."""
        components, signal, of_strain = self._components, innovation.of_map, innovation.of_strain
        table, (mean, spread) = components.spread.take(nodes, axis=1), gain
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
            mean, spread = (np.concatenate([each.take(place, axis=1), each], axis=1) for each in gain)
        variance, log_prior = table[:-1], table[-1]
        of_strain = of_strain.astype(np.float32)
        if self._transform is not None:
            signal, of_strain = signal @ self._transform.T, self._transform @ of_strain
        variance += self.noise.layout.mean(innovation.level_variance).astype(np.float32)[:, None]
        residual = of_strain - signal
        energy = self._sums @ np.square(signal).T
        product = (self._sums * of_strain) @ signal.T - energy
        # From the residual of a gain of one to that of the mean gain.
        more = 1.0 - mean
        squared = self._sums @ np.square(residual, out=residual).T + more * (2.0 * product + more * energy)
        product += more * energy
        projected, along = spread * np.square(product), spread * energy
        return _Residuals(place, squared, product, energy, projected, along, variance, log_prior)
