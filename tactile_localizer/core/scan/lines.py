"""Lines of a scan, each of one or more sweeps: spacing, repetitions, and differences of their strains."""

import numpy as np

from tactile_localizer.core.scan.tracks import PITCH, Tracks, evenly

_MAX_TRACKS, _MAX_POINTS = 50, 20
"""Tracks, spread over the scan, and points of each, from which the line spacing is computed."""
_MAX_REPEATS = 8
"""Sweeps over one line that are recognized as such."""
_JUMP = 3.0
"""Ratio of the distances to the next two tracks from which the nearer one repeats a line: at most two in
parallel lines."""


def line_spacing(tracks: Tracks) -> float:
    """Median distance from a point to the nearest track of another line, m; on one axis near zero."""
    if len(tracks) < 2:
        return 0.0
    nearest = []
    for index in evenly(len(tracks), _MAX_TRACKS):
        distances = _distances(tracks, index)
        nearest.append(distances[:, ~_on_line(distances, index)].min(axis=1))
    return float(np.median(np.concatenate(nearest)))


def differences_between_lines(tracks: Tracks) -> np.ndarray:
    """Magnitudes of the differences (n, C), V, between strains at neighbouring places of two lines.

    On one axis, between two sweeps; of a single sweep, between one point and the next.
    """
    if len(tracks) == 1:
        return np.abs(np.diff(tracks.strain, axis=0))
    differences = []
    for index in evenly(len(tracks), _MAX_TRACKS):
        own, others = tracks.slices[index], np.flatnonzero(~_on_line(_distances(tracks, index), index))
        near = tracks.nearest(tracks.positions[own], others, 1)[1][:, 0]
        differences.append(np.abs(tracks.strain[own] - tracks.strain[near]))
    return np.concatenate(differences)


def _on_line(distances: np.ndarray, index: int) -> np.ndarray:
    """Tracks (S,) bool that repeat the line of one of them, itself included, by ``distances`` (n, S) from it.

    On one axis, where all tracks do, it is that one alone.
    """
    away = np.maximum(np.median(distances, axis=0), PITCH)
    away[index] = 0.0
    order = np.argsort(away, kind="stable")[: _MAX_REPEATS + 1]
    jumps = np.flatnonzero(away[order[2:]] > _JUMP * away[order[1:-1]])
    own = np.zeros(len(away), dtype=bool)
    own[order[: jumps[-1] + 2 if len(jumps) else 1]] = True
    return own


def _distances(tracks: Tracks, index: int) -> np.ndarray:
    """Distances (n, S) from points spread over a track to each of the tracks, m."""
    own = tracks.positions[tracks.slices[index]]
    return tracks.nearest(own[:: max(1, len(own) // _MAX_POINTS)])[0]
