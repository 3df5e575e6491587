"""Sweep mixture: what a phalanx feels at a place is an interpolation between two sweeps around it."""

from __future__ import annotations

import copy
from functools import cached_property

import numpy as np

from tactile_localizer.core.likelihood.drift import Drift, Innovation, Trend
from tactile_localizer.core.likelihood.gain import LEAST_VARIANCE
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.on_map import Felt, MapLikelihood, OnMap, Places
from tactile_localizer.core.likelihood.other_material import OtherMaterial
from tactile_localizer.core.likelihood.scatter import Whitening
from tactile_localizer.core.likelihood.strain_map import StrainMap

_LARGEST_STRAIN = 1e9
"""Largest whitened strain, at which others are clipped; its square is still a float32."""

_CHANGED = 0.2
"""Change of the covariance, in variances of the noise, from which strains are whitened anew."""


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
    excess : (C, C) V^2, covariance by which the strains of the sweep have more noise than the scan's
    log_volume : (F,) logarithms of the volumes of whitened strains, for densities over strains in volts
    """

    def __init__(
        self,
        noise: NoiseModel,
        strain_map: StrainMap,
        drift: Drift,
        other: OtherMaterial,
        material: Material,
    ) -> None:
        self.noise, self.map, self.drift, self.material = noise, strain_map, drift, material
        self._other_in_scan = other
        layout = noise.layout
        self._map_likelihood = MapLikelihood(strain_map, layout)
        self.gain_variance = max(strain_map.gain, LEAST_VARIANCE)
        self._turns = bool(strain_map.turning.any())
        self.excess = np.zeros((len(noise.centre),) * 2)
        self.log_volume = noise.log_volume
        self._whitening = np.eye(noise.layout.size)
        self._transform: np.ndarray | None = None

    def with_noise(self, excess: np.ndarray) -> SweepMixture:
        """The model of a sweep whose strains have more noise than the scan's, by ``excess`` (C, C), V^2."""
        model = self.with_whitening(Whitening.of(self.noise.layout, self.noise.with_excess(excess)))
        model.excess = excess
        model.__dict__.pop("_unchanged", None)
        return model

    def is_changed(self, excess: np.ndarray) -> bool:
        """Whether an ``excess`` (C, C), V^2, differs from :attr:`excess` by a fifth of the noise."""
        return bool(np.count_nonzero(np.abs(excess - self.excess) > self._unchanged))

    @cached_property
    def _unchanged(self) -> np.ndarray:
        width = np.sqrt(self.noise.variance + self.excess.diagonal())
        return _CHANGED * np.outer(width, width)

    def with_whitening(self, whitening: Whitening) -> SweepMixture:
        """The model of strains whose residuals are white after a transform of the units of this model.

        It shares the tables: residuals are whitened anew when they are evaluated.
        """
        model = copy.copy(self)
        model.log_volume = self.log_volume + whitening.log_volume
        model._whitening = whitening.transform @ self._whitening
        model._transform = np.ascontiguousarray(model._whitening.T, dtype=np.float32)
        model.__dict__.pop("other", None)
        return model

    def whitening_after(self, other: SweepMixture) -> np.ndarray:
        """Transform (W, W) to the coordinates of this model from those of an ``other`` one of the scan."""
        return np.linalg.solve(other._whitening.T, self._whitening.T).T

    @cached_property
    def other(self) -> OtherMaterial:
        """Material that was not scanned."""
        other = self._other_in_scan
        return other if self._transform is None else other.transformed(self._whitening)

    def innovation(
        self,
        trend: Trend,
        strain: np.ndarray,
        places: np.ndarray,
        map_strain: np.ndarray,
        weights: np.ndarray,
        travel: float,
        exponent: float,
        measured: np.ndarray | None = None,
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
            return self.drift.update(trend, whitened, map_strain, travel, exponent, measured)
        states = places[: len(weights)]
        mean = weights @ states
        noise = (weights @ (states - mean) ** 2) @ turning**2
        known = exponent / (1.0 + noise / self.drift.variance)
        innovation, trend = self.drift.update(
            trend, whitened - mean @ turning, map_strain, travel, known, measured
        )
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
        return self._map_likelihood.expected(places)

    def off_map(self, innovation: Innovation) -> tuple[np.ndarray, np.ndarray]:
        """Innovation (C,) of a strain from featureless material, and the variance (F,) of its level."""
        of_strain = innovation.of_strain
        if self._transform is not None:
            of_strain = of_strain @ self._transform
        return of_strain, self.noise.layout.mean(innovation.level_variance)

    def felt(self, innovation: Innovation, used: np.ndarray) -> Felt:
        """The innovation of a strain, of which the phalanges ``used`` (F,) bool count, as it is compared."""
        of_strain, transform = innovation.of_strain.astype(np.float32), self._transform
        if transform is not None:
            of_strain = of_strain @ transform
        level_variance = self.noise.layout.mean(innovation.level_variance).astype(np.float32)
        return Felt(of_strain, transform, level_variance, used)

    def on_map(self, felt: Felt, places: Places, exponent: float) -> OnMap:
        """Likelihoods of a strain at places, and the gain after this fraction of a measurement."""
        return self._map_likelihood.of(felt, places, exponent)

    def moments(self, felt: Felt, places: Places, weights: np.ndarray) -> np.ndarray:
        """Second moments (W, W) of the residuals of a strain at the states, of ``weights`` (P,).

        In the variance of a visit, a block per phalanx.
        """
        return self._map_likelihood.moments(felt, places, weights)

    def direction(self, strain: np.ndarray) -> np.ndarray:
        """Where a force that varies moves a strain (C,), V, in whitened coordinates (W,): along itself."""
        return np.asarray(self._whitening @ (self.noise.whitening @ strain))
