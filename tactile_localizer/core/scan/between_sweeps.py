"""Training pairs interpolated between the sweeps of a scan, for the kernel models.

A scan is dense along its sweeps and sparse across them, so that a kernel density would have to be as wide as
the gaps. Pairs interpolated between neighbouring sweeps fill the gaps. Pairs interpolated across a sweep,
between its two neighbours, represent the variation of deformable material from sweep to sweep.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import nearest_of_other_sweeps, scaled_states
from tactile_localizer.scene import Scene

_STEP = 0.2
"""Distance between the pairs kept along a sweep, in sweep spacings."""
_NEAREST, _FARTHEST = 0.5, 2.5
"""Distances between sweeps that are bridged, in sweep spacings: the neighbours, and one beyond."""
_PER_SPACING = 2
"""Pairs interpolated per sweep spacing."""


def with_interpolated_sweeps(scan: Scan, scene: Scene) -> Scan:
    """The scan, thinned along its sweeps, with pairs interpolated between neighbouring sweeps.

    States and strains are interpolated linearly between each pair and the nearest pair of every other sweep
    that is 0.5 to 2.5 sweep spacings away. A single sweep, and sweeps as dense across as along, are returned
    unchanged.
    """
    if len(scan.sweep_numbers) < 2:
        return scan
    scaled = scaled_states(scan, scene)
    spacing = float(np.median(nearest_of_other_sweeps(scan, scene)[2]))
    if _STEP * spacing <= float(np.median(np.linalg.norm(np.diff(scaled, axis=0), axis=1))):
        return scan
    thin = scan.select(_thinned(scaled, scan.sweep, _STEP * spacing))
    scaled = scaled_states(thin, scene)
    wraps = np.zeros(len(scan.axes), dtype=bool)
    wraps[scene.columns(scan.axes)] = scene.wraps
    rows = [np.flatnonzero(thin.sweep == number) for number in thin.sweep_numbers]
    trees = [cKDTree(scaled[own]) for own in rows]
    states, strain, sweep = [thin.states], [thin.strain], [thin.sweep]
    for a, own in enumerate(rows):
        for b in range(a + 1, len(rows)):
            if _box_distance(trees[a], trees[b]) > _FARTHEST * spacing:
                continue
            distance, nearest = trees[b].query(scaled[own], distance_upper_bound=_FARTHEST * spacing)
            joined = np.flatnonzero(np.isfinite(distance) & (distance >= _NEAREST * spacing))
            count = np.rint(_PER_SPACING * distance[joined] / spacing).astype(int)
            repeated = np.repeat(joined, count)
            fraction = ((_numbered(count) + 1.0) / np.repeat(count + 1.0, count))[:, None]
            start, end = own[repeated], rows[b][nearest[repeated]]
            step = thin.states[end] - thin.states[start]
            step[:, wraps] = wrap_angle(step[:, wraps])
            states.append(thin.states[start] + fraction * step)
            strain.append(thin.strain[start] + fraction * (thin.strain[end] - thin.strain[start]))
            sweep.append(thin.sweep[start])
    return replace(
        scan, states=np.concatenate(states), strain=np.concatenate(strain), sweep=np.concatenate(sweep)
    )


def _thinned(scaled: np.ndarray, sweep: np.ndarray, step: float) -> np.ndarray:
    """Indices of the first pair in each ``step`` of travel along each sweep."""
    kept = []
    for number in np.unique(sweep):
        own = np.flatnonzero(sweep == number)
        travel = np.cumsum(np.linalg.norm(np.diff(scaled[own], axis=0, prepend=scaled[own[:1]]), axis=1))
        kept.append(own[np.unique(np.floor(travel / step), return_index=True)[1]])
    return np.concatenate(kept)


def _box_distance(one: cKDTree, other: cKDTree) -> float:
    """Distance between the bounding boxes of two sweeps, a lower bound of the distance between them."""
    gap = np.maximum(one.mins - other.maxes, other.mins - one.maxes)
    return float(np.linalg.norm(np.maximum(gap, 0.0)))


def _numbered(count: np.ndarray) -> np.ndarray:
    """0, 1, ..., count - 1 for each count, concatenated."""
    return np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
