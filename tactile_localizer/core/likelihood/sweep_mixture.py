"""Sweep mixture: what a phalanx feels at a place is an interpolation between two sweeps around it."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from tactile_localizer.core.likelihood.drift import Drift, Innovation, Trend
from tactile_localizer.core.likelihood.evaluation import Likelihoods
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.other_material import OtherMaterial
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import log_density

_RESEMBLING = 9.0
"""Variance, in variances of a visit, about what is expected, of material that resembles the map: three times
as far from it. By judgement."""
_LARGEST_STRAIN = 1e9
"""Largest whitened strain, at which others are clipped; its square is still a float32."""


class SweepMixture:
    """Student-t mixture over pairs of sweeps on either side of a place, from tables (:class:`.StrainMap`).

    Parameters
    ----------
    noise : noise model, which whitens strains
    strain_map : tables of expected strain and variance
    drift : filter of what a sweep differs by
    other : material that was not scanned
    information_length : m of travel per independent measurement of the position

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
        information_length: float,
    ) -> None:
        self.noise, self.map, self.drift, self.other = noise, strain_map, drift, other
        self.information_length = information_length
        layout, nodes = noise.layout, len(strain_map.mean)
        self._nodes, self._components = nodes, strain_map.mean.shape[1]
        # One component after another: the first is needed for all places, the others for some.
        self._mean = np.ascontiguousarray(strain_map.mean.swapaxes(0, 1)).reshape(-1, layout.size)
        variance = np.moveaxis(strain_map.variance, (0, 1, 2), (2, 1, 0))
        self._variance = np.ascontiguousarray(variance).reshape(layout.phalanges, -1)
        self._log_prior = np.ascontiguousarray(strain_map.log_prior.T)
        self._channels = np.array(layout.counts, dtype=np.float32)[:, None]
        # A product with these rows sums over the channels of each phalanx.
        self._sums = layout.expand(np.eye(layout.phalanges, dtype=np.float32))
        # Where all components are the same, as on featureless material, the first one is enough. The
        # difference is as large as the table: once glibc has released that much, it keeps the arrays of an
        # update in the process, which otherwise take twice as long while the belief is open.
        tables = strain_map.mean, strain_map.variance
        self._differs = np.any([(each - each[:, :1]).any(axis=(1, 2)) for each in tables], axis=0)
        self.excess = np.zeros(layout.size)
        self._transform: np.ndarray | None = None

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
        expected: np.ndarray,
        log_weights: np.ndarray,
        travel: float,
        information: float,
    ) -> tuple[Innovation, Trend]:
        """Innovations of a strain (C,), V, and of the map's ``expected`` strain (N, C) at places (N, d).

        See :meth:`.Drift.update`. ``log_weights`` (P,) are those of the first places, the states.

        What a sweep differs by is the same at every yaw, while the strain of featureless material turns with
        the hand. So the trend is that of the strain less the one at the mean yaw, whose variance counts as
        noise. With a trend for each yaw a turned hand's yaw was 2.7 instead of 0.8 degrees off, because at
        contact the yaw at which a phalanx deformed alike was preferred.
        """
        strain, turning = self.whitened(strain), self.map.turning
        if not turning.any():
            return self.drift.update(trend, strain, expected, travel, information)
        weights, states = np.exp(log_weights), places[: len(log_weights)]
        mean = weights @ states
        noise = (weights @ (states - mean) ** 2) @ turning**2
        known = information / (1.0 + noise / self.drift.variance)
        innovation, trend = self.drift.update(trend, strain - mean @ turning, expected, travel, known)
        turned = ((places - mean) @ turning).astype(np.float32)
        innovation = innovation._replace(
            map=innovation.map + turned, map_trend=innovation.map_trend - turned, turned=mean @ turning
        )
        return innovation, trend

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """A strain vector (C,), V, in whitened coordinates."""
        return self.noise.whitened(strain).clip(-_LARGEST_STRAIN, _LARGEST_STRAIN)

    def in_volts(self, whitened: np.ndarray) -> np.ndarray:
        """The strain vector (C,), V, of a whitened one."""
        return np.asarray(np.linalg.solve(self.noise.whitening, whitened)) + self.noise.centre

    def expected(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (N,) nearest to places (N, d), and the whitened strain there (N, C), first component."""
        nodes = self.map.nearest(places)
        return nodes, self._mean.take(nodes, axis=0)

    def off_map(self, innovation: Innovation) -> tuple[np.ndarray, np.ndarray]:
        """Innovation (C,) of a strain from featureless material, and the variance (F,) of its level."""
        strain = innovation.strain
        if self._transform is not None:
            strain = self._transform @ strain
        return strain, self.noise.layout.mean(innovation.level_variance)

    def evaluate(
        self,
        nodes: np.ndarray,
        states: int,
        likeliest: int,
        innovation: Innovation,
        scale: np.ndarray,
        used: np.ndarray,
    ) -> Likelihoods:
        """Log-likelihoods of a strain at states and reference places.

        Parameters
        ----------
        nodes : (N,) of the map, nearest to the P states and then to the R reference places
        states : their number P
        likeliest : index of the likeliest of them before this strain
        innovation : of the strain and of the map at these N places
        scale : (F,) factor of the variance of a visit in this sweep
        used : (F,) bool, phalanges that count
        """
        places, gain = len(nodes), np.float32(self.map.gain)
        # States at which all components are evaluated, the likeliest last.
        mixed = np.append(self._differs.take(nodes[:states]).nonzero()[0], likeliest)
        further = self._nodes * np.arange(1, self._components)[:, None]
        rows = np.concatenate([nodes, (nodes[mixed] + further).ravel()])
        expected = self._mean.take(rows, axis=0)
        target = innovation.strain.astype(np.float32) + innovation.map_trend
        if self._transform is not None:
            expected, target = expected @ self._transform.T, target @ self._transform.T
        residual = np.empty_like(expected)
        np.subtract(target, expected[:places], out=residual[:places])
        others = residual[places:].reshape(len(further), len(mixed), len(innovation.strain))
        np.subtract(target.take(mixed, axis=0), expected[places:].reshape(others.shape), out=others)
        variance = self._variance.take(rows, axis=1)
        variance *= scale.astype(np.float32)[:, None]
        variance += self.noise.layout.mean(innovation.level_variance).astype(np.float32)[:, None]
        projected = gain * np.square(self._sums @ (residual * expected).T)
        gain_variance = gain * (self._sums @ np.square(expected, out=expected).T)
        squared = self._sums @ np.square(residual, out=residual).T

        plain = log_density(squared, variance, self._channels, projected, gain_variance) * used[:, None]
        log_prior = self._log_prior.take(nodes[mixed], axis=1)
        by_component = np.concatenate([plain.take(mixed, axis=1), plain[:, places:]], axis=1)
        plain[:, mixed] = _mixed(by_component.reshape(len(used), -1, len(mixed)) + log_prior)
        at_places = plain[:, :places].sum(axis=0, dtype=np.float64)
        own = np.r_[likeliest, places - 1 + len(mixed) * np.arange(1, self._components)]
        resembling = log_density(
            squared[:, own],
            _RESEMBLING * variance[:, own],
            self._channels,
            projected[:, own],
            gain_variance[:, own],
        )
        resembling = _mixed((resembling + log_prior[:, -1])[..., None])[:, 0].astype(np.float64)
        return Likelihoods(at_places[:states], at_places[states:], resembling)


def _mixed(log_densities: np.ndarray) -> np.ndarray:
    """Logarithms of the sums over components, (F, K, P) to (F, P)."""
    largest = log_densities.max(axis=1)
    log_densities -= largest[:, None]
    return np.asarray(largest + np.log(np.exp(log_densities, out=log_densities).sum(axis=1)))
