"""Parameters of the sweep mixture, learned from a scan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.likelihood.drift import OUTLIER, Drift
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import Visits, WhitenedScan, whiten
from tactile_localizer.core.likelihood.other_material import OtherMaterial
from tactile_localizer.core.likelihood.strain_map import (
    StrainMap,
    VarianceModel,
    build_maps,
    cell_size,
    fit_variance,
)
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene


class SweepModel(NamedTuple):
    """What is learned from the sweeps of a scan.

    Parameters
    ----------
    scan : the whitened scan, without the strain to which the variance was fitted
    variance : variance model
    """

    scan: WhitenedScan
    variance: VarianceModel

    def mixture(self, scene: Scene, cell: np.ndarray) -> SweepMixture:
        """The measurement model for cells (d,) of a grid."""
        return self.mixtures(scene, cell, [np.zeros(len(self.scan.tracks), dtype=bool)])[0]

    def mixtures(self, scene: Scene, cell: np.ndarray, without: Sequence[np.ndarray]) -> list[SweepMixture]:
        """The same, each with a map without some of the tracks (S,) bool."""
        tables = build_maps(self.scan, self.variance, scene, cell, without)
        return [self._of_map(scene, table) for table in tables]

    def _of_map(self, scene: Scene, table: StrainMap) -> SweepMixture:
        noise, material = self.scan.noise, self.scan.material
        visit = float(np.median(table.variance))
        signal = float(np.square(table.mean[:, 0]).sum(axis=1).max())
        largest = OUTLIER * (signal + noise.layout.size * visit)
        drift = Drift(material.memory, visit, noise.level_variance, largest)
        return SweepMixture(noise, table, drift, self._other(scene, table), material)

    def part(self, points: np.ndarray) -> SweepModel:
        """The model of some ``points`` (n,) bool of the scan's tracks, with noise and variance of all."""
        scan = self.scan
        tracks, of = scan.tracks.part(points)
        kept = scan._replace(tracks=tracks, held_out=None, levels=scan.levels[of], signal=scan.signal[points])
        return self._replace(scan=kept)

    def _other(self, scene: Scene, table: StrainMap) -> OtherMaterial:
        """The alternative to a map."""
        layout, material = self.scan.noise.layout, self.scan.material
        along, pitch = table.shape[0], float(table.step[0] * levers(scene)[0])
        mean = table.mean[:, 0].astype(np.float64).reshape(along, -1)
        signal = material.innovations(mean, pitch).reshape(-1, layout.size)
        covariance = np.zeros((layout.size, layout.size))
        for own in layout.slices:
            part = signal[:, own]
            felt = part[np.square(part).sum(axis=1) > 1.0]
            part = felt if len(felt) > 10 else part
            covariance[own, own] = part.T @ part / max(len(part), 1)
        # Its featureless part is what the map's own featureless places are: neither is preferred there.
        return OtherMaterial(layout, covariance, table.variance.min(axis=(0, 1)))

    def cell(self, scene: Scene, lines: float, times: float = 1.0) -> np.ndarray:
        """Size (d,) of cells of ``lines`` line spacings, and ``times`` it (:func:`.cell_size`)."""
        return cell_size(scene, self.scan.spacing, lines, times)


def learn_sweep_model(
    scan: Scan, scene: Scene, material: Material, variance: VarianceModel | None = None
) -> SweepModel:
    """Estimate the noise of a scan of a ``material``, and its variance between the sweeps.

    ``variance`` was fitted to the same scan; ``None``: fitted now.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    return _fitted(whiten(Visits.of(scan, scene), material), variance)


def learn_sweep_models(scan: Scan, scene: Scene, kinds: Sequence[Material]) -> list[SweepModel]:
    """Those of several ``kinds`` of material, with the arguments and errors of :func:`learn_sweep_model`."""
    visits = Visits.of(scan, scene)
    return [_fitted(whiten(visits, kind)) for kind in kinds]


def _fitted(scan: WhitenedScan, variance: VarianceModel | None = None) -> SweepModel:
    """The model of a scan, whose strain is as large as all else, and not needed any more."""
    return SweepModel(scan._replace(strain=None), variance or fit_variance(scan))
