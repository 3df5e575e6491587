"""Sweep mixture: what a phalanx feels at a place is an interpolation between two sweeps around it."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.drift import Drift, Innovation, Trend
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.other_material import OtherMaterial
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import log_density

_ALIKE = 0.3
"""Difference of two components, in noise widths of a visit, below which they are one. It saves time."""
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
    energy : (F, n) float32, its squared length
    variance : (F, n) float32, variance of a new visit about it
    log_prior : (n,) float32
    """

    counts: np.ndarray
    starts: np.ndarray
    mean: np.ndarray
    energy: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray


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
        by_phalanx, kept_mean = np.ascontiguousarray(variance[kept].T), mean[kept]
        energy = self._sums @ np.square(kept_mean).T
        return _Components(counts, starts, kept_mean, energy, by_phalanx, log_prior[kept])

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
        factor: np.ndarray,
        used: np.ndarray,
    ) -> np.ndarray:
        """Log-likelihoods (N,) of a strain at states and anchors.

        Parameters
        ----------
        nodes : (N,) of the map, nearest to the P states and then to the R anchors
        states : their number P
        innovation : of the strain, with the map's trend at these N places
        factor : (F,) of the variance of a visit in this sweep
        used : (F,) bool, phalanges that count
        """
        components, gain = self._components, np.float32(self.map.gain)
        counts = components.counts.take(nodes)
        counts[states:] = 1  # anchors: the first component alone
        ends = counts.cumsum()
        starts = ends - counts
        place = np.arange(len(nodes)).repeat(counts)
        rows = np.arange(len(place)) + (components.starts.take(nodes) - starts).take(place)
        map_strain, energy = components.mean.take(rows, axis=0), components.energy.take(rows, axis=1)
        detrended = innovation.of_strain.astype(np.float32) + innovation.map_trend
        if self._transform is not None:
            map_strain, detrended = map_strain @ self._transform.T, detrended @ self._transform.T
            energy = self._sums @ np.square(map_strain).T
        residual = detrended.take(place, axis=0)
        residual -= map_strain
        variance = components.variance.take(rows, axis=1)
        variance *= factor.astype(np.float32)[:, None]
        variance += self.noise.layout.mean(innovation.level_variance).astype(np.float32)[:, None]
        map_strain *= residual
        projected = gain * np.square(self._sums @ map_strain.T)
        squared = self._sums @ np.square(residual, out=residual).T
        log_prior = components.log_prior.take(rows)
        log_prior[ends[states - 1] :] = 0.0

        plain = log_density(squared, variance, self._channels, projected, gain * energy) + log_prior
        # Relative to the first component, which is faster than to the largest of each place.
        first = plain.take(starts, axis=1).astype(np.float64)
        ratios = np.exp(np.minimum(plain - first.take(place, axis=1), _LARGEST_LOG_RATIO))
        return np.asarray(used @ (first + np.log([np.bincount(place, each) for each in ratios])))
