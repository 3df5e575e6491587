"""The sweep mixture's parameters, learned from a scan."""

from __future__ import annotations

from typing import NamedTuple

from tactile_localizer.core.likelihood.noise_model import NoiseEstimate, estimate_noise
from tactile_localizer.core.likelihood.strain_map import VarianceModel, build_map, cell_size, fit_variance
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene


class SweepModel(NamedTuple):
    """Noise and variance of the visits of a scan."""

    noise: NoiseEstimate
    variance: VarianceModel

    def mixture(self, scene: Scene, lines: float, without: tuple[int, ...] = ()) -> SweepMixture:
        """The measurement model for cells of ``lines`` spacings, without some of the tracks."""
        tracks = [track for index, track in enumerate(self.noise.tracks) if index not in without]
        cell = cell_size(scene, self.noise.spacing, lines)
        nodes = {"nodes_per_cell": 1} if without else {}
        table = build_map(tracks, scene, self.noise.spacing, cell, self.variance, **nodes)
        return SweepMixture(self.noise.model, table, self.variance, cell)


def learn_sweep_model(scan: Scan, scene: Scene) -> SweepModel:
    """Learn the noise of the scan's visits, and how it grows where the map has to interpolate.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    noise = estimate_noise(scan, scene)
    return SweepModel(noise, fit_variance(noise, scene))
