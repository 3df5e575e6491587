"""Checks of a scan: early endings, coverage, dead channels, a single sweep, copies.

The thresholds are judgement, each with its reason; the user decides what to do about a finding.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.scan.coverage import Coverage
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import ENDED, RecordedSweep
from tactile_localizer.scene import Scene

_MIN_PAIRS = 50
"""Pairs below which a channel cannot be checked."""
_COVERED = 0.5
"""Coverage of the bounds below which it is reported: a margin around the scan is no defect."""
_ANOTHER_UNIT = 0.01
"""Coverage below which the bounds seem to be in another unit; a single line covers more."""
_DEAD = 0.01
"""Range of a dead channel, as a fraction of the median channel's."""
_REPEATED = 0.1
"""Difference between sweeps, in the noise between samples, below which one is a copy: 1.4 if independent."""
_SECOND_DIFFERENCE = 6.0**0.5
"""Standard deviation of the second difference of samples with unit noise: variances 1, 4 and 1."""
_COMPARED = 200
"""Pairs of a sweep that are compared with other sweeps."""
_NEIGHBOURS = 8
"""Nearest pairs among which one of another sweep is looked for."""


def findings(scan: Scan, scene: Scene, sweeps: Sequence[RecordedSweep]) -> list[str]:
    """Findings about a scan that may need attention, one line for each kind.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds
    sweeps : as stored
    """
    found = []
    if early := [sweep.number for sweep in sweeps if sweep.ending != ENDED]:
        found.append(f"recording ended early: sweep {_listed(map(str, early))}")
    if len(scan.sweep_numbers) == 1:
        found.append("only one sweep: the noise between sweeps cannot be estimated")
    coverage = Coverage(scene)
    coverage.add(scan.states)
    if coverage.fraction < _COVERED:
        unit = " (bounds in mm?)" if coverage.fraction < _ANOTHER_UNIT else ""
        found.append(f"coverage: only {coverage.fraction:.0%} of the scene's bounds lie near a pair{unit}")
    spread = np.ptp(scan.strain, axis=0)
    if len(scan) >= _MIN_PAIRS and (dead := np.flatnonzero(spread <= _DEAD * np.median(spread)).tolist()):
        places = [scan.layout.place(column) for column in dead]
        names = _listed(f"{scan.phalanges[phalanx]} {channel}" for phalanx, channel in places)
        found.append(f"channels that seem dead, of nearly constant strain: {names}")
    if copies := _listed(f"{one} and {other}" for one, other in _copies(scan)):
        found.append(f"sweeps that seem to be copies: {copies}; the noise learned from them is too small")
    return found


def _copies(scan: Scan) -> list[tuple[int, int]]:
    """Pairs of sweeps that differ by much less than the noise between successive samples."""
    tree = cKDTree(scan.states)
    found = set()
    for number in scan.sweep_numbers.tolist():
        rows = np.flatnonzero(scan.sweep == number)
        noise = _size(np.diff(scan.strain[rows], n=2, axis=0)) / _SECOND_DIFFERENCE
        rows = rows[np.linspace(0, len(rows) - 1, min(_COMPARED, len(rows))).astype(int)]
        _, near = tree.query(scan.states[rows], k=list(range(1, min(_NEIGHBOURS, len(scan)) + 1)))
        is_other = scan.sweep[near] != number
        has_other = is_other.any(axis=1)
        others = near[np.arange(len(rows)), is_other.argmax(axis=1)]
        if 2 * np.count_nonzero(has_other) <= len(rows):
            continue
        difference = _size(scan.strain[rows[has_other]] - scan.strain[others[has_other]])
        if difference < _REPEATED * noise:
            twin = int(np.bincount(scan.sweep[others[has_other]]).argmax())
            found.add((min(twin, number), max(twin, number)))
    return sorted(found)


def _listed(names: Iterator[str]) -> str:
    """At most ten names, and how many more there are."""
    every = list(names)
    return ", ".join(every[:10]) + (f" and {len(every) - 10} more" if len(every) > 10 else "")


def _size(differences: np.ndarray) -> float:
    """Median over the rows of the root mean square over the channels; 0 without rows."""
    return float(np.median(np.sqrt(np.mean(differences**2, axis=1)))) if len(differences) else 0.0
