"""Parameters of the sweep mixture, learned from a scan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from tactile_localizer.core.likelihood.drift import OUTLIER, Drift, innovations
from tactile_localizer.core.likelihood.noise_model import WhitenedScan, whiten
from tactile_localizer.core.likelihood.other_material import ENERGY_MEMORY, OtherMaterial
from tactile_localizer.core.likelihood.strain_map import (
    StrainMap,
    VarianceModel,
    build_map,
    cell_size,
    fit_variance,
)
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import PITCH, evenly
from tactile_localizer.scene import Scene

_CORRELATED = 20, 400
"""Sweeps from which the map's innovations are taken, and points of each: 0.2 m."""


class SweepModel(NamedTuple):
    """What is learned from the sweeps of a scan.

    Parameters
    ----------
    scan : the whitened scan
    variance : variance model
    """

    scan: WhitenedScan
    variance: VarianceModel

    @property
    def information_length(self) -> float:
        """Travel per independent measurement of the position, m."""
        return self.scan.material.information_length

    @property
    def presence_length(self) -> float:
        """Travel per independent measurement of the material, m: all places share errors of the map."""
        return max(self.information_length, self.variance.summed_correlation)

    def mixture(self, scene: Scene, cell: np.ndarray) -> SweepMixture:
        """The measurement model for cells (d,) of a grid."""
        noise, memory = self.scan.noise, self.scan.material.memory
        table = build_map(self.scan, self.variance, scene, cell)
        spread = table.featureless_variance
        if spread is None:
            spread = float(np.median(table.variance))
        signal = float(np.square(table.mean[:, 0]).sum(axis=1).max())
        largest = OUTLIER * (signal + noise.layout.size * spread)
        drift = Drift(memory, spread, noise.offset_variance, largest)
        return SweepMixture(noise, table, drift, self._other(scene, table, spread), self.information_length)

    def quiet_energy(self, mixture: SweepMixture) -> np.ndarray:
        """Usual energy (F,) of the innovations of the scan's sweeps from featureless material."""
        layout, exponent = self.scan.noise.layout, PITCH / self.information_length
        width, found = round(ENERGY_MEMORY / PITCH), []
        for own in self.scan.tracks.slices:
            strain = self.scan.strain[own]
            known = exponent * np.arange(len(strain))[:, None] + mixture.drift.prior
            level = exponent * (np.cumsum(strain, axis=0) - strain) / np.maximum(known, 1e-9)
            variance = layout.mean(mixture.drift.variance / np.maximum(known, 1e-9))
            energy = mixture.other.energy(strain - level, variance)
            found.append(uniform_filter1d(energy, width, axis=0, mode="nearest"))
        return np.maximum(np.median(np.concatenate(found), axis=0), 1e-3)

    def _other(self, scene: Scene, table: StrainMap, spread: float) -> OtherMaterial:
        """The alternative to a map."""
        layout = self.scan.noise.layout
        if self.scan.material.has_level:
            signal = table.mean[:, 0].astype(np.float64)
        else:
            signal = np.concatenate(self._innovations(scene, table))
        covariance = np.zeros((layout.size, layout.size))
        for own in layout.slices:
            part = signal[:, own]
            felt = part[np.square(part).sum(axis=1) > 1.0]
            part = felt if len(felt) > 10 else part
            covariance[own, own] = part.T @ part / max(len(part), 1)
        return OtherMaterial(layout, covariance, spread)

    def cell(self, scene: Scene, lines: float) -> np.ndarray:
        """Size (d,) of cells of ``lines`` line spacings."""
        return cell_size(scene, self.scan.spacing, lines)

    def _innovations(self, scene: Scene, table: StrainMap) -> list[np.ndarray]:
        """Innovations (n, C) of the map along sweeps of the scan."""
        tracks, points = _CORRELATED
        along = []
        for index in evenly(len(self.scan.tracks), tracks):
            positions = self.scan.tracks.positions[self.scan.tracks.slices[index]]
            inside = ((positions >= scene.lower) & (positions <= scene.upper)).all(axis=1)
            if inside.any():
                expected = table.mean[table.nearest(positions[inside][:points]), 0]
                along.append(innovations(expected.astype(np.float64), self.scan.material.memory, PITCH))
        return along


def learn_sweep_model(scan: Scan, scene: Scene, variance: VarianceModel | None = None) -> SweepModel:
    """Estimate the noise of a scan and its variance between the sweeps.

    ``variance`` was fitted to the same scan; ``None``: fitted now.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    whitened = whiten(scan, scene)
    return SweepModel(whitened, variance or fit_variance(whitened))
