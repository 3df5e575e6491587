"""Neighbouring lines of a scan: their distance, and the difference of the strains on them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Scene

_MAX_SAMPLES = 4000
"""Pairs from which neighbours are sought, spread over the scan."""


def neighbours_on_other_lines(scan: Scan, scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest neighbours in another sweep of pairs spread over the scan; a single sweep counts as two.

    Returns
    -------
    own, nearest : (M,) indices of the pairs and of their neighbours
    distance : (M,) between them, m

    Raises
    ------
    ScanError
        The scan is a single pair.
    """
    if len(scan) < 2:
        raise ScanError(f"scan: expected at least 2 pairs, found {len(scan)}")
    places = scan.positions_on(scene) * levers(scene)
    sweep = scan.sweep if len(scan.sweep_numbers) > 1 else np.arange(len(scan)) % 2
    found = []
    for number in np.unique(sweep):
        own = np.flatnonzero(sweep == number)[:: max(1, len(sweep) // _MAX_SAMPLES)]
        others = np.flatnonzero(sweep != number)
        distance, nearest = cKDTree(places[others]).query(places[own])
        found.append((own, others[nearest], distance))
    own, nearest, distance = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return own, nearest, distance
