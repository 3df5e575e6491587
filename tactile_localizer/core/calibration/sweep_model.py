"""Parameters of the sweep mixture, learned from a scan."""

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
"""Correlation lengths of the signal per independent measurement in another session: over a shorter distance
any material can be fitted by an offset and a gain. By judgement; tried on two fabrics."""


class SweepModel(NamedTuple):
    """Noise estimate and variance model of a scan."""

    noise: NoiseEstimate
    variance: VarianceModel

    def mixture(
        self, scene: Scene, lines: float, information_length: float, without: tuple[int, ...] = ()
    ) -> SweepMixture:
        """The measurement model for cells of ``lines`` spacings, without some of the tracks."""
        spacing = self.noise.spacing
        cell = cell_size(scene, spacing, lines)
        nodes = {"nodes_per_cell": 1} if without else {}
        table = build_map(
            [track for index, track in enumerate(self.noise.tracks) if index not in without],
            scene,
            spacing,
            cell,
            self.variance,
            self.noise.featureless,
            self.noise.model.turning,
            **nodes,
        )
        session = None
        # A grid on three axes has too many cells to estimate an offset for each.
        if not self.noise.featureless and scene.dimension < 3:
            session = NewSession(
                self.noise.model, table, _CORRELATIONS_PER_MEASUREMENT * self.variance.signal_correlation
            )
        correlation = self.variance.summed_correlation
        return SweepMixture(self.noise.model, table, cell, information_length, correlation, session)


def learn_sweep_model(
    scan: Scan, scene: Scene, whitening: np.ndarray | None = None, variance: VarianceModel | None = None
) -> SweepModel:
    """Estimate the noise of a scan and its variance between the sweeps.

    Parameters
    ----------
    whitening : (C, C) to use instead of the scan's own (:func:`.common_whitening`)
    variance : fitted to the same scan under the same whitening; ``None``: fitted now

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    noise = estimate_noise(scan, scene, whitening)
    return SweepModel(noise, variance or fit_variance(noise, scene))


def learn_comparable(candidates: Sequence[tuple[Scan, Scene]]) -> list[SweepModel]:
    """Learn the models of several scans in the same coordinates, so that their densities are comparable.

    They have a common whitening and a common prior of a sweep's offset, but individual variance models: with
    the mean of four fabrics, one was mistaken for another. Raises as :func:`learn_sweep_model`.
    """
    own = [estimate_noise(scan, scene).model for scan, scene in candidates]
    whitening = common_whitening(own)
    noises = with_common_offsets([estimate_noise(scan, scene, whitening) for scan, scene in candidates])
    return [
        SweepModel(noise, fit_variance(noise, scene))
        for noise, (_, scene) in zip(noises, candidates, strict=True)
    ]
