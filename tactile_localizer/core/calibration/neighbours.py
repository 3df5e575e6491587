"""How many neighbours the Gaussian models average over, chosen by the likelihood of held-out sweeps.

The paper has 8 (Fig. 6). More neighbours make a covariance that needs less shrinkage, but of pairs that are
further away. Each number is judged by the mean log-density that a map without a sweep gives to the strains of
that sweep, at their true positions on the feature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from tactile_localizer.core.calibration.kernel_widths import held_out_log_densities
from tactile_localizer.core.geometry.phalanges import on_feature
from tactile_localizer.core.likelihood.gaussian import Gaussian, Shrinkage
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Scene

NEIGHBOURS = (2, 4, 8, 16, 32, 64, 128, 256)
"""Not more: an update costs in proportion, and 512 gain at most 0.3 nats on the simulated features."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class NeighbourTrial:
    """One number of neighbours.

    Parameters
    ----------
    neighbours : k
    shrinkage : of the covariance, and what it does on held-out sweeps
    score : log-likelihood of held-out sweeps, nats a strain
    """

    neighbours: int
    shrinkage: Shrinkage
    score: float


def search_neighbours(scan: Scan, scene: Scene, progress: Progress | None = None) -> list[NeighbourTrial]:
    """Score all :data:`NEIGHBOURS` for the Gaussian model with full covariance.

    Parameters
    ----------
    scan, scene : training pairs and their scene
    progress : called with a description of the step and its completed fraction

    Raises
    ------
    ScanError
        The scan has no pairs on the feature.
    """
    rows = np.flatnonzero(on_feature(scene, scan.states[:, scene.columns(scan.axes)]))
    if not len(rows):
        raise ScanError(f"scan: expected pairs in the feature region of scene {scene.name}, found none")
    trials = []
    for count, k in enumerate(NEIGHBOURS):
        if progress is not None:
            progress("choosing the number of neighbours", count / len(NEIGHBOURS))
        build = partial(Gaussian, scene=scene, neighbours=k)
        _, scores = held_out_log_densities(scan, scene, rows, build)
        trials.append(NeighbourTrial(k, build(scan).shrinkage, float(scores.mean())))
    if progress is not None:
        progress("choosing the number of neighbours", 1.0)
    return trials
