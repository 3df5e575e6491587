"""Checks of a scan: coverage, spacing of the lines, dead or saturated channels, copies, early endings.

The thresholds are judgement, each with its reason; the user decides what to do about a finding.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.scan.coverage import Coverage
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import ENDED, RecordedSweep
from tactile_localizer.offline.axes import MM
from tactile_localizer.scene import Scene

_MIN_PAIRS = 50
"""Pairs below which a channel cannot be checked."""

_COVERED = 0.5
"""Coverage of the bounds below which it is reported: a margin around the scan is no defect."""

_MIN_LINES = 4
_SAME_LINE = 0.25
"""Distance within which sweeps are on one line (there and back), in mean distances of the sweeps."""
_STRAIGHT = 0.5
"""Deviation from a straight line, in spacings, above which the sweeps are not compared as lines."""
_MISSING_LINE = 1.7
"""Distance of neighbouring lines that is reported, in median distances: 2 where a line is missing."""

_DEAD = 0.01
"""Range of a dead channel, as a fraction of the median channel's."""

_AT_LIMIT = 0.01
"""Fraction of samples at exactly the highest or lowest value from which a channel seems saturated. Noisy
values have one highest sample, coarse counts a few."""

_REPEATED = 0.1
"""Difference between sweeps, in the noise between samples, below which one is a copy: 1.4 if independent."""
_SECOND_DIFFERENCE = 6.0**0.5
"""Standard deviation of the second difference of samples with unit noise: variances 1, 4 and 1."""
_COMPARED = 200
"""Pairs of a sweep that are compared with other sweeps."""
_NEIGHBOURS = 8
"""Nearest pairs among which one of another sweep is looked for."""


def findings(scan: Scan, scene: Scene, sweeps: Sequence[RecordedSweep]) -> list[str]:
    """Findings about a scan that may need attention.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds
    sweeps : as stored
    """
    found = [
        f"sweep {sweep.number}: its recording {sweep.ending}, after {len(sweep)} pairs"
        for sweep in sweeps
        if sweep.ending != ENDED
    ]
    if len(scan.sweep_numbers) == 1:
        found.append("only one sweep: the noise between sweeps cannot be estimated")
    return [*found, *_coverage(scan, scene), *_lines(scan), *_channels(scan), *copied_sweeps(scan)]


def _coverage(scan: Scan, scene: Scene) -> Iterator[str]:
    coverage = Coverage(scene)
    coverage.add(scan.states)
    if coverage.fraction < _COVERED:
        yield f"coverage: only {coverage.fraction:.0%} of the scene's bounds lie near a pair"


def _lines(scan: Scan) -> Iterator[str]:
    """Distances between neighbouring lines, where the sweeps are straight and parallel in the plane."""
    if "x" not in scan.axes or "y" not in scan.axes:
        return
    columns = [scan.axes.index("x"), scan.axes.index("y")]
    paths = [scan.states[scan.sweep == number][:, columns] for number in scan.sweep_numbers]
    centred = np.concatenate([path - path.mean(axis=0) for path in paths])
    across = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    across *= np.sign(across[np.argmax(np.abs(across))])
    places = np.sort([np.median(path @ across) for path in paths])
    mean = float(np.ptp(places)) / max(len(places) - 1, 1)
    distances = np.diff(places)
    distances = distances[distances > _SAME_LINE * mean]
    if len(distances) + 1 < _MIN_LINES:
        return
    spacing = float(np.median(distances))
    if float(np.median([np.std(path @ across) for path in paths])) > _STRAIGHT * spacing:
        return
    widest = int(np.argmax(np.diff(places)))
    if np.diff(places)[widest] > _MISSING_LINE * spacing:
        ends = [
            " ".join(
                f"{name} {value * MM:.1f}" for name, value in zip("xy", np.median(path, axis=0), strict=True)
            )
            for path in sorted(paths, key=lambda path: float(np.median(path @ across)))[widest : widest + 2]
        ]
        yield (
            f"uneven lines: {spacing * MM:.1f} mm apart (median), but {np.diff(places)[widest] * MM:.1f} mm "
            f"between those around {ends[0]} and {ends[1]}"
        )


def _channels(scan: Scan) -> Iterator[str]:
    if len(scan) < _MIN_PAIRS:
        return
    high, low = scan.strain.max(axis=0), scan.strain.min(axis=0)
    typical = float(np.median(high - low))
    for column in range(scan.strain.shape[1]):
        phalanx, channel = scan.layout.place(column)
        name = f"{scan.phalanges[phalanx]} channel {channel}"
        if high[column] - low[column] <= _DEAD * typical:
            yield f"{name}: seems dead, all values lie within {high[column] - low[column]:.3g}"
            continue
        values = scan.strain[:, column]
        for limit in (low[column], high[column]):
            fraction = float(np.mean(values == limit))
            # Many sensors read 0 without contact, which is not the end of their range.
            if fraction > _AT_LIMIT and limit != 0.0:
                yield f"{name}: seems saturated, {fraction:.1%} of the values are exactly {limit:.6g}"


def copied_sweeps(scan: Scan) -> Iterator[str]:
    """Sweeps that differ from another one by much less than the noise between successive samples.

    The noise that is learned between sweeps would be far too small.
    """
    tree = cKDTree(scan.states)
    for number in scan.sweep_numbers:
        rows = np.flatnonzero(scan.sweep == number)
        noise = _size(np.diff(scan.strain[rows], n=2, axis=0)) / _SECOND_DIFFERENCE
        rows = rows[np.linspace(0, len(rows) - 1, min(_COMPARED, len(rows))).astype(int)]
        _, near = tree.query(scan.states[rows], k=list(range(1, min(_NEIGHBOURS, len(scan)) + 1)))
        is_other = scan.sweep[near] != number
        found = is_other.any(axis=1)
        others = near[np.arange(len(rows)), is_other.argmax(axis=1)]
        if 2 * np.count_nonzero(found) <= len(rows):
            continue
        difference = _size(scan.strain[rows[found]] - scan.strain[others[found]])
        if difference < _REPEATED * noise:
            twin = np.bincount(scan.sweep[others[found]]).argmax()
            yield (
                f"sweep {number}: differs from sweep {twin} by {difference:.2g}, samples in a row by "
                f"{noise:.2g}: is it a copy? The noise learned from the scan is too small"
            )


def _size(differences: np.ndarray) -> float:
    """Median over the rows of the root mean square over the channels; 0 without rows."""
    return float(np.median(np.sqrt(np.mean(differences**2, axis=1)))) if len(differences) else 0.0
