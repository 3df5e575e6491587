"""Which pairs of a scan are known to be featureless: the paper's Lambda (III-D)."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from tactile_localizer.core.likelihood.kernels.normal import Normal
from tactile_localizer.core.likelihood.sum_of_gaussians import training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_ORDINARY = 1.0 - 1e-4
"""Probability of a normal distribution within which strains count as ordinary."""
_ROUNDS = 20


def featureless_pairs(scan: Scan, scene: Scene) -> np.ndarray:
    """Pairs off the scene's region with all phalanges, which feel as the others of their sweep do: (N,) bool.

    A glitch of a load cell, or the fringe of a feature that its region does not quite hold, would make
    featureless material look as if anything could be felt there. Without a region no pair is known.
    """
    positions, strain = training_pairs(scan, scene)
    featureless = ~scene.on_feature(positions)
    rows = np.flatnonzero(featureless)
    if len(rows):
        numbers, index = np.unique(scan.sweep[rows], return_inverse=True)
        common = np.stack([np.median(strain[rows[index == k]], axis=0) for k in range(len(numbers))])
        featureless[rows] = ordinary(strain[rows] - common[index])
    return featureless


def ordinary(samples: np.ndarray) -> np.ndarray:
    """Which of samples (N, D) lie where a normal distribution fitted to these has its probability: (N,) bool.

    Found by trimming until none is left to trim. A group that is more than a few per cent of all is wide
    enough by itself to be kept.
    """
    limit = float(chi2.ppf(_ORDINARY, samples.shape[1]))
    kept = np.ones(len(samples), dtype=bool)
    for _ in range(_ROUNDS):
        inside = Normal.fitted(samples[kept]).squared_distance(samples) <= limit
        if (inside == kept).all():
            break
        kept = inside
    return kept
