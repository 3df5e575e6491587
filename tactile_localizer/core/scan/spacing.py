"""Spacing of the sweeps of a scan, and the difference of their strains at neighbouring places."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Scene

_LEAST_WIDTH = 0.002
"""m, or rad: least spacing, for sweeps that run over each other."""


def divided(sweep: np.ndarray) -> np.ndarray:
    """Sweep numbers (N,); a single sweep is split into two interleaved ones, so that one can be held out."""
    return sweep if len(np.unique(sweep)) > 1 else np.arange(len(sweep)) % 2


def nearest_of_other_sweeps(scan: Scan, scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest neighbours in another sweep of pairs spread over the scan.

    Returns
    -------
    own, nearest : (M,) indices of the pairs and of their neighbours
    distance : (M,) between them, as fractions of the scene's extents

    Raises
    ------
    ScanError
        The scan is a single pair.
    """
    if len(scan) < 2:
        raise ScanError(f"scan: expected at least 2 pairs, found {len(scan)}")
    states, sweep = scaled_states(scan, scene), divided(scan.sweep)
    found = []
    for number in np.unique(sweep):
        own = np.flatnonzero(sweep == number)[:: max(1, len(sweep) // 4000)]
        others = np.flatnonzero(sweep != number)
        distance, nearest = cKDTree(states[others]).query(states[own])
        found.append((own, others[nearest], distance))
    own, nearest, distance = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return own, nearest, distance


def base_widths(scan: Scan, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Kernel widths of the right order of magnitude, from :func:`nearest_of_other_sweeps`.

    Returns
    -------
    position : (d,) m (yaw: rad), median distance of neighbours in different sweeps
    strain : (C,) V, median difference of their strains
    """
    own, nearest, distance = nearest_of_other_sweeps(scan, scene)
    strain = scan.strain_on(scene)
    spread = np.median(np.abs(strain[own] - strain[nearest]), axis=0)
    # A positive width also for a channel in which most sweeps agree exactly.
    spread = np.maximum(spread, 1e-3 * strain.std(axis=0) + 1e-12 * np.abs(strain).max(axis=0) + 1e-30)
    spacing = max(float(np.median(distance)), 0.002) * scene.extent
    return np.maximum(spacing, _LEAST_WIDTH), spread


def scaled_states(scan: Scan, scene: Scene) -> np.ndarray:
    """States (N, d) on the scene's axes, as fractions of its extents."""
    return scan.positions_on(scene) / scene.extent
