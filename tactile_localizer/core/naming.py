"""What tells one feature from another, which is not what tells one place from another."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tactile_localizer.core.filters.resampling import evenly
from tactile_localizer.core.filters.weights import log_mean
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians, training_pairs
from tactile_localizer.core.scan.between_sweeps import with_interpolated_sweeps
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import nearest_of_other_sweeps
from tactile_localizer.scene import Scene

_STATES = 48
"""States drawn evenly from the belief to ask what should be felt."""
_RIDGE = 0.05
"""Share of a channel's variance that is added to the diagonal of the covariance."""


class Namer:
    """Explains strains by a scan in coordinates in which neighbouring sweeps differ alike in all directions.

    Sweeps side by side differ much in a few combinations of the channels, as grip and sheet lie differently,
    and hardly in the others. A feature is known by the others, so here each counts by how well sweeps agree
    on it. A place is not found so well this way: what differs from sweep to sweep differs from place to
    place too.

    Parameters
    ----------
    scan, scene : the training pairs of one candidate
    position_std : (d,) kernel widths in position, m (yaw: rad), the same for all candidates
    covariance : (C, C) of the sweeps' differences, V^2, the same for all candidates
    """

    def __init__(self, scan: Scan, scene: Scene, position_std: np.ndarray, covariance: np.ndarray) -> None:
        alone = scene.layout.same_phalanx
        # Without all phalanges, those that are left are explained each by itself.
        self._whiten = [np.linalg.inv(np.linalg.cholesky(c)) for c in (covariance * alone, covariance)]
        self._models = [self._model(scan, scene, position_std, each) for each in self._whiten]

    @staticmethod
    def _model(scan: Scan, scene: Scene, position_std: np.ndarray, whiten: np.ndarray) -> SumOfGaussians:
        white = training_pairs(scan, scene)[1] @ whiten.T
        scan = Scan(scan.states, white, scan.sweep, scan.axes, scene.phalanx_names, scene.layout.counts)
        scan = with_interpolated_sweeps(scan, scene)
        return SumOfGaussians(scan, scene, position_std, np.ones(len(whiten)), precision="float32")

    def log_density(
        self, states: np.ndarray, weights: np.ndarray, strain: np.ndarray, present: np.ndarray
    ) -> float:
        """Of a strain where the belief is, nats.

        Parameters
        ----------
        states, weights : (P, d) and (P,), the belief
        strain, present : (C,) V without the sweep's offset, and (F,) bool
        """
        drawn = states[evenly(weights, _STATES)]
        together = int(present.all())
        white = self._whiten[together] @ strain
        return log_mean(self._models[together].log_likelihood(drawn, white, present))


def disagreement(candidates: Iterable[tuple[Scan, Scene]]) -> np.ndarray:
    """Covariance (C, C) of a strain on the feature about that of the sweep beside it, in all scans, V^2."""
    differences = []
    for scan, scene in candidates:
        positions, strain = training_pairs(scan, scene)
        own, nearest, _ = nearest_of_other_sweeps(scan, scene)
        differences.append((strain[own] - strain[nearest])[scene.on_feature(positions[own])])
    difference = np.concatenate(differences)
    # Both sweeps vary: each has half of the square.
    covariance = difference.T @ difference / (2 * len(difference))
    variance = np.diag(covariance)
    return np.asarray(covariance + np.diag(_RIDGE * variance + 1e-12 * variance.max() + 1e-30))
