"""Parameters of the sweep mixture, learned from a scan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.hypotheses.correlation import Correlation
from tactile_localizer.core.likelihood.drift import OUTLIER, Drift, innovations
from tactile_localizer.core.likelihood.noise_model import TREND_MEMORY, WhitenedScan, estimate_noise
from tactile_localizer.core.likelihood.strain_map import (
    NODES_PER_CELL,
    StrainMap,
    VarianceModel,
    build_map,
    cell_size,
    fit_variance,
    local_scale,
    summed_correlation,
)
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import PITCH, Track, evenly
from tactile_localizer.scene import Scene

INFORMATION_LENGTHS = (0.0017, 0.005)
"""Travel per independent measurement where the material has featureless parts, and where it is felt
everywhere, m. By judgement: errors of the map are correlated along a sweep, so that consecutive strains are
not independent measurements. On a bump of a physics engine and three features of another simulator 1 to 3 mm
are equal within their errors; 5 mm delays convergence. On four fabrics 3 and 5 mm are equal; with 1.7 mm 3 %
of the starts do not end right and converged."""
_CORRELATED = 20, 400
"""Sweeps from which the map's innovations are taken, and points of each: 0.2 m."""


class SweepModel(NamedTuple):
    """Noise estimate and variance model of a scan.

    Parameters
    ----------
    noise : noise estimate
    variance : variance model
    scale : tracks of a local factor of the variance, where the material is felt everywhere
    """

    noise: WhitenedScan
    variance: VarianceModel
    scale: list[Track] | None

    @property
    def information_length(self) -> float:
        """Travel per independent measurement of the position, m."""
        return INFORMATION_LENGTHS[0 if self.noise.featureless else 1]

    @property
    def presence_length(self) -> float:
        """Travel per independent measurement of the material, m: all places share errors of the map."""
        return max(self.information_length, self.variance.summed_correlation)

    def mixture(self, scene: Scene, cell: np.ndarray, without: tuple[int, ...] = ()) -> SweepMixture:
        """The measurement model for cells (d,) of a grid, without some of the tracks."""
        noise = self.noise
        table = build_map(
            [track for index, track in enumerate(noise.tracks) if index not in without],
            scene,
            noise.spacing,
            cell,
            self.variance,
            noise.featureless,
            noise.model.turning,
            self.scale,
            1 if without else NODES_PER_CELL,
        )
        channels = noise.model.layout.size
        memory, spread, level = np.inf, table.featureless_variance, noise.model.offset_variance
        if spread is None:
            memory, spread, level = TREND_MEMORY, float(np.median(table.variance)), np.full(channels, np.inf)
        signal = float(np.square(table.mean[:, 0]).sum(axis=1).max())
        drift = Drift(memory, spread, level, OUTLIER * (signal + channels * spread))
        return SweepMixture(noise.model, table, drift, self.information_length)

    def cell(self, scene: Scene, lines: float) -> np.ndarray:
        """Size (d,) of cells of ``lines`` line spacings."""
        return cell_size(scene, self.noise.spacing, lines)

    def correlation(self, scene: Scene, table: StrainMap) -> Correlation | None:
        """Evidence for the map; ``None`` where featureless material is the alternative."""
        if self.noise.featureless:
            return None
        tracks, points = _CORRELATED
        along = []
        for index in evenly(len(self.noise.tracks), tracks):
            positions = self.noise.tracks[index].positions
            inside = ((positions >= scene.lower) & (positions <= scene.upper)).all(axis=1)
            if inside.any():
                expected = table.mean[table.nearest(positions[inside][:points]), 0]
                along.append(innovations(expected.astype(np.float64), TREND_MEMORY, PITCH))
        length = summed_correlation(along, TREND_MEMORY)
        places = float(np.prod(np.maximum(scene.extent * levers(scene) / length, 1.0)))
        return Correlation(np.concatenate(along), float(np.median(table.variance)), places)


def learn_sweep_model(scan: Scan, scene: Scene, variance: VarianceModel | None = None) -> SweepModel:
    """Estimate the noise of a scan and its variance between the sweeps.

    ``variance`` was fitted to the same scan; ``None``: fitted now.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    noise = estimate_noise(scan, scene)
    variance = variance or fit_variance(noise, scene)
    is_scaled = not noise.featureless and len(noise.tracks) > 1
    return SweepModel(noise, variance, local_scale(noise, scene, variance) if is_scaled else None)
