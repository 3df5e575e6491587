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
        # A product with these columns sums over the channels of each phalanx.
        self._columns = layout.expand(np.eye(layout.phalanges, dtype=np.float32)).T
        self._energy = self._by_phalanx(np.square(self._mean))
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
        model._energy = self._by_phalanx(np.square(self._mean @ model._transform.T))
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
        further = (nodes[:states] + self._nodes * np.arange(1, self._components)[:, None]).ravel()
        rows = np.concatenate([nodes, further])
        strain = innovation.strain.astype(np.float32)
        expected = self._mean.take(rows, axis=0)
        residual = np.empty_like(expected)
        np.subtract(strain, innovation.map, out=residual[:places])
        if len(further):
            target = strain + innovation.map_trend[:states]
            others = expected[places:].reshape(-1, states, len(strain))
            np.subtract(target, others, out=residual[places:].reshape(others.shape))
        if self._transform is not None:
            residual, expected = residual @ self._transform.T, expected @ self._transform.T
        variance = self._variance.take(rows, axis=1)
        variance *= scale.astype(np.float32)[:, None]
        variance += self.noise.layout.mean(innovation.level_variance).astype(np.float32)[:, None]
        projected = gain * np.square(self._by_phalanx(np.multiply(residual, expected, out=expected)))
        gain_variance = gain * self._energy.take(rows, axis=1)
        squared = self._by_phalanx(np.square(residual, out=residual))

        plain = log_density(squared, variance, self._channels, projected, gain_variance) * used[:, None]
        by_component = np.concatenate([plain[:, :states], plain[:, places:]], axis=1)
        by_component = by_component.reshape(len(used), self._components, states)
        own = np.r_[likeliest, places + likeliest + states * np.arange(self._components - 1)]
        resembling = log_density(
            squared[:, own],
            _RESEMBLING * variance[:, own],
            self._channels,
            projected[:, own],
            gain_variance[:, own],
        )
        if self._components > 1:
            by_component += self._log_prior.take(nodes[:states], axis=1)
            resembling += self._log_prior[:, nodes[likeliest]]
        at_states = _mixed(by_component).sum(axis=0)
        at_references = plain[:, states:places].sum(axis=0).astype(np.float64)
        return Likelihoods(at_states, at_references, _mixed(resembling[..., None])[:, 0])

    def _by_phalanx(self, values: np.ndarray) -> np.ndarray:
        """Sums over the channels of each phalanx, (N, C) to (F, N)."""
        return np.ascontiguousarray((values @ self._columns).T)


def _mixed(log_densities: np.ndarray) -> np.ndarray:
    """Logarithms of the sums over components, (F, K, P) to (F, P) float64."""
    if log_densities.shape[1] == 1:
        return log_densities[:, 0].astype(np.float64)
    largest = log_densities.max(axis=1)
    log_densities -= largest[:, None]
    largest += np.log(np.exp(log_densities, out=log_densities).sum(axis=1))
    return largest.astype(np.float64)
