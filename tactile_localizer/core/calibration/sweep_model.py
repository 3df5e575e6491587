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

_LOOKS_PER_TEST = 3.0
"""Lengths of information that make one independent test of the map: *whether* the hand is on it gathers more
cautiously than *where*, because all places share the map's own errors. Also lengths of the signal's summed
autocorrelation that make one test in another session: with two, 1 of 15 starts on another fabric converged
falsely, with three none of 18. By judgement."""
_CORRELATIONS_PER_TEST = 2.2
"""The same in lengths of the residual's summed autocorrelation. By judgement; 1.5 was tried too, on
three simulated features."""


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
            tracks, scene, self.noise.spacing, cell, self.variance, self.noise.featureless, **nodes
        )
        presence_length = max(
            _LOOKS_PER_TEST * information_length, _CORRELATIONS_PER_TEST * self.variance.summed_correlation
        )
        session = None
        # A grid on three axes has too many cells for each to carry what it learns.
        if not self.noise.featureless and scene.dimension < 3:
            session = NewSession(self.noise.model, table, _LOOKS_PER_TEST * self.variance.signal_correlation)
        return SweepMixture(self.noise.model, table, cell, information_length, presence_length, session)


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
