"""The sweep mixture's parameters, learned from a scan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.new_session import NewSession
from tactile_localizer.core.likelihood.noise_model import (
    NoiseEstimate,
    common_whitening,
    estimate_noise,
    with_common_offsets,
)
from tactile_localizer.core.likelihood.strain_map import VarianceModel, build_map, cell_size, fit_variance
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_CORRELATIONS_PER_MEASUREMENT = 2.0
"""Lengths of the signal's summed autocorrelation that make one measurement in another session: on a shorter
way an offset and a gain fit any material. By judgement; tried on two fabrics."""


class SweepModel(NamedTuple):
    """Noise and variance of the visits of a scan."""

    noise: NoiseEstimate
    variance: VarianceModel

    def mixture(
        self, scene: Scene, lines: float, information_length: float, without: tuple[int, ...] = ()
    ) -> SweepMixture:
        """The measurement model for cells of ``lines`` spacings, without some of the tracks."""
        tracks = [track for index, track in enumerate(self.noise.tracks) if index not in without]
        cell = cell_size(scene, self.noise.spacing, lines)
        nodes = {"nodes_per_cell": 1} if without else {}
        table = build_map(
            tracks,
            scene,
            self.noise.spacing,
            cell,
            self.variance,
            self.noise.featureless,
            self.noise.model.turning,
            **nodes,
        )
        session = None
        # A grid on three axes has too many cells for each to carry what it learns.
        if not self.noise.featureless and scene.dimension < 3:
            session = NewSession(
                self.noise.model, table, _CORRELATIONS_PER_MEASUREMENT * self.variance.signal_correlation
            )
        correlation = self.variance.summed_correlation
        return SweepMixture(self.noise.model, table, cell, information_length, correlation, session)


def learn_sweep_model(
    scan: Scan, scene: Scene, whitening: np.ndarray | None = None, variance: VarianceModel | None = None
) -> SweepModel:
    """Learn the noise of the scan's visits, and how it grows where the map has to interpolate.

    Parameters
    ----------
    whitening : (C, C) to take instead of the scan's own (:func:`.common_whitening`)
    variance : fitted before, to the same scan and under the same whitening; ``None``: fitted now

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    noise = estimate_noise(scan, scene, whitening)
    return SweepModel(noise, variance or fit_variance(noise, scene))


def learn_comparable(candidates: Sequence[tuple[Scan, Scene]]) -> list[SweepModel]:
    """Learn several scans in the same coordinates, so that a strain's densities on them can be compared.

    Whitening and prior of a sweep's offset are common to them. The variance of a visit is each material's
    own: under the mean of four fabrics' one was taken for another. Raises as :func:`learn_sweep_model`.
    """
    own = [estimate_noise(scan, scene).model for scan, scene in candidates]
    whitening = common_whitening(own)
    noises = with_common_offsets([estimate_noise(scan, scene, whitening) for scan, scene in candidates])
    return [
        SweepModel(noise, fit_variance(noise, scene))
        for noise, (_, scene) in zip(noises, candidates, strict=True)
    ]
