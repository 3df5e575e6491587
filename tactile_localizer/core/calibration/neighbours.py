"""Choice of the number of neighbours of the Gaussian models, by the likelihood of held-out sweeps.

The paper uses 8 (Fig. 6). With more neighbours the covariance needs less shrinkage, but the pairs are farther
away. A number's score is the mean log-density of the strains of a sweep, at their true positions on the
feature, under a map without that sweep.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.kernel_widths import held_out_log_densities
from tactile_localizer.core.geometry.phalanges import on_feature
from tactile_localizer.core.likelihood.gaussian import Gaussian
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Scene

NEIGHBOURS = (2, 4, 8, 16, 32, 64, 128, 256)
"""Candidates. The cost of an update is proportional; 512 gain at most 0.3 nats on the simulated features."""

Progress = Callable[[str, float], None]


class NeighbourTrial(NamedTuple):
    """Result for one number of neighbours.

    Parameters
    ----------
    neighbours : k
    shrinkage : :attr:`.Shrinkage.intensity` of the covariance
    score : log-likelihood of held-out sweeps, nats per measurement
    """

    neighbours: int
    shrinkage: float
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
    rows = np.flatnonzero(on_feature(scene, scan.positions_on(scene)))
    if not len(rows):
        raise ScanError(f"scan: expected pairs in the feature region of scene {scene.name}, found none")
    trials = []
    for count, k in enumerate(NEIGHBOURS):
        if progress is not None:
            progress("choosing the number of neighbours", count / len(NEIGHBOURS))
        build = partial(Gaussian, scene=scene, neighbours=k)
        score = float(held_out_log_densities(scan, scene, rows, build).mean())
        trials.append(NeighbourTrial(k, build(scan).shrinkage.intensity, score))
    if progress is not None:
        progress("choosing the number of neighbours", 1.0)
    return trials
