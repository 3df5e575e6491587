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
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, log_density, weight

_ALIKE = 0.3
"""Difference of two components, in noise widths of a visit, below which they are one. It saves time."""
_MEAN_SQUARE = DEGREES_OF_FREEDOM / (DEGREES_OF_FREEDOM - 2.0)
"""Variance of the t-distribution, in that of its scale."""
_LARGEST_STRAIN = 1e9
"""Largest whitened strain, at which others are clipped; its square is still a float32."""
_LARGEST_LOG_RATIO = 700.0
"""Of the densities of two components, nats: its exponential is a float64."""


class _Components(NamedTuple):
    """The n components of M nodes, those of one node after those of another.

    Parameters
    ----------
    counts, starts : (M,) int, number of a node's components, and the first of them
    mean : (n, C) float32, whitened strain
    variance : (F, n) float32, variance of a new visit about it
    log_prior : (n,) float32
    """

    counts: np.ndarray
    starts: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray


class _Residuals(NamedTuple):
    """Residuals of a strain from the n components of N places, those of one place after those of another.

    Parameters
    ----------
    place, starts : (n,) int, place of each component, and (N,) int, the first component of each place
    squared : (F, n) float32, squared residual at the mean gain
    product, energy : (F, n) float32, of the signal with the residual, and its squared length
    spread : (F, n) float32, variance of the gain
    variance : (F, n) float32, of a visit
    log_prior : (n,) float32, of the components
    """

    place: np.ndarray
    starts: np.ndarray
    squared: np.ndarray
    product: np.ndarray
    energy: np.ndarray
    spread: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray

    def first(self, places: int) -> _Residuals:
        """Those of the first ``places``."""
        count = int(np.searchsorted(self.place, places))
        each = (values[..., :count] for values in self[2:])
        return _Residuals(self.place[:count], self.starts[:places], *each)

    def log_likelihoods(self, variance: np.ndarray, channels: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Log-likelihoods (N,) of the phalanges ``used`` (F,) bool, with ``variance`` (F, n) of a visit."""
        projected, along = self.spread * np.square(self.product), self.spread * self.energy
        plain = log_density(self.squared, variance, channels, projected, along) + self.log_prior
        if len(self.place) == len(self.starts):
            return np.asarray(used @ plain.astype(np.float64))
        # Relative to the first component, which is faster than to the largest of each place.
        first = plain.take(self.starts, axis=1).astype(np.float64)
        ratios = np.exp(np.minimum(plain - first.take(self.place, axis=1), _LARGEST_LOG_RATIO))
        return np.asarray(used @ (first + np.log([np.bincount(self.place, each) for each in ratios])))


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
        kept = ~alike
        kept[:, 0] = True
        counts = kept.sum(axis=1)
        starts = counts.cumsum() - counts
        by_phalanx = np.ascontiguousarray(variance[kept].T)
        return _Components(counts, starts, mean[kept], by_phalanx, log_prior[kept])

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
        if not turning.any():
            return self.drift.update(trend, whitened, map_strain, travel, exponent)
        states = places[: len(weights)]
        mean = weights @ states
        noise = (weights @ (states - mean) ** 2) @ turning**2
        known = exponent / (1.0 + noise / self.drift.variance)
        innovation, trend = self.drift.update(trend, whitened - mean @ turning, map_strain, travel, known)
        turned = ((places - mean) @ turning).astype(np.float32)
        map_trend = innovation.map_trend - turned
        return innovation._replace(map_trend=map_trend, turned=mean @ turning), trend

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """A strain vector (C,), V, in whitened coordinates."""
        return self.noise.whitened(strain).clip(-_LARGEST_STRAIN, _LARGEST_STRAIN)

    def in_volts(self, strain: np.ndarray, whitened: np.ndarray) -> np.ndarray:
        """A strain vector (C,), V, moved to where it is ``whitened`` (W,)."""
        return strain + self.noise.inverse @ (whitened - self.noise.whitened(strain))

    def map_at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (N,) nearest to places (N, d), and the whitened strain there (N, C), first component."""
        nodes = self.map.nearest(places)
        return nodes, self._components.mean.take(self._components.starts.take(nodes), axis=0)

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
        innovation : of the strain, with the map's trend at these N places
        gain : of the sweep's signal along the trajectories to these N places
        scale : (F,) of the squared residuals of the sweep, in those of the scan
        used : (F,) bool, phalanges that count
        """
        felt = self._residuals(nodes, states, innovation, gain)
        larger = np.maximum(scale, 1.0).astype(np.float32)[:, None]
        likelihoods = felt.log_likelihoods(felt.variance, self._channels, used)
        at_states = position = likelihoods[:states]
        if (larger > 1.0).any():
            of_states = felt.first(states)
            position = of_states.log_likelihoods(of_states.variance * larger, self._channels, used)
        at = felt.starts
        squared, product, energy, spread, variance = (each.take(at, axis=1) for each in felt[2:7])
        gained, energies = spread * np.square(product), spread * energy
        in_sweep = variance * larger
        left = np.maximum(squared - gained / (in_sweep + energies), 0.0) / in_sweep
        counted = weight(left, self._channels) / in_sweep
        squared = np.maximum(squared - gained / (variance + energies), 0.0) / variance
        squared = squared[:, :states] / (_MEAN_SQUARE * self._channels)
        return OnMap(at_states, likelihoods[states:], position, squared, counted * energy, counted * product)

    def _residuals(self, nodes: np.ndarray, states: int, innovation: Innovation, gain: Gain) -> _Residuals:
        """Residuals of a strain from the components at states and anchors; see :meth:`on_map`."""
        components = self._components
        counts = components.counts.take(nodes)
        counts[states:] = 1  # anchors: the first component alone
        ends = counts.cumsum()
        starts = ends - counts
        place = np.arange(len(nodes)).repeat(counts)
        rows = np.arange(len(place)) + (components.starts.take(nodes) - starts).take(place)
        signal = components.mean.take(rows, axis=0)
        signal -= innovation.map_trend.take(place, axis=0)
        of_strain = innovation.of_strain.astype(np.float32)
        if self._transform is not None:
            signal, of_strain = signal @ self._transform.T, self._transform @ of_strain
        residual = of_strain - signal
        energy, product = self._sums @ np.square(signal).T, self._sums @ (signal * residual).T
        # From the residual of a gain of one to that of the mean gain.
        more = 1.0 - gain.mean.take(place, axis=1)
        squared = self._sums @ np.square(residual).T + more * (2.0 * product + more * energy)
        product += more * energy
        variance = components.variance.take(rows, axis=1)
        variance += self.noise.layout.mean(innovation.level_variance).astype(np.float32)[:, None]
        log_prior = components.log_prior.take(rows)
        log_prior[ends[states - 1] :] = 0.0
        spread = gain.variance.take(place, axis=1)
        return _Residuals(place, starts, squared, product, energy, spread, variance, log_prior)
