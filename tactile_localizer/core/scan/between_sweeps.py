"""The material between the sweeps of a scan: strains interpolated from one sweep to the next.

A scan is dense along its sweeps and sparse across them, and material that deforms feels different from sweep
to sweep. A kernel density alone has to be as wide as the gaps. Pairs interpolated between a sweep and its
neighbours fill the gaps, and those between the sweeps on either side of one show what else its place may feel
like.
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
"""Distance of the pairs that are kept along a sweep, in spacings of the sweeps."""
_GAP = 0.5
_REACH = 2.5
"""Distances between sweeps that are bridged, in spacings: neighbours, and those on either side of one."""
_PER_SPACING = 2
"""Pairs that are put into each spacing."""


def leaves_gaps(scan: Scan, scene: Scene) -> bool:
    """Whether the sweeps lie farther apart than the pairs along them."""
    if len(scan.sweep_numbers) < 2:
        return False
    steps = np.linalg.norm(np.diff(scaled_states(scan, scene), axis=0), axis=1)
    return _STEP * _spacing(scan, scene) > float(np.median(steps))


def with_interpolated_sweeps(scan: Scan, scene: Scene) -> Scan:
    """The scan, thinned along its sweeps, with pairs interpolated between neighbouring sweeps.

    Each pair is joined to the nearest pair of every other sweep between 0.5 and 2.5 spacings away; the states
    and strains in between are linear. A scan whose sweeps leave no gaps is returned as it is.
    """
    if not leaves_gaps(scan, scene):
        return scan
    spacing = _spacing(scan, scene)
    thin = scan.select(_thinned(scaled_states(scan, scene), scan.sweep, _STEP * spacing))
    scaled = scaled_states(thin, scene)
    wraps = np.zeros(len(scan.axes), dtype=bool)
    wraps[scene.columns(scan.axes)] = scene.wraps
    rows = [np.flatnonzero(thin.sweep == number) for number in thin.sweep_numbers]
    trees = [cKDTree(scaled[own]) for own in rows]
    states, strain, sweep = [thin.states], [thin.strain], [thin.sweep]
    for a, own in enumerate(rows):
        for b in range(a + 1, len(rows)):
            if _apart(trees[a], trees[b]) > _REACH * spacing:
                continue
            distance, nearest = trees[b].query(scaled[own], distance_upper_bound=_REACH * spacing)
            joined = np.flatnonzero(np.isfinite(distance) & (distance >= _GAP * spacing))
            count = np.rint(_PER_SPACING * distance[joined] / spacing).astype(int)
            repeated = np.repeat(joined, count)
            share = (_numbered(count) + 1.0) / np.repeat(count + 1.0, count)
            start, end = own[repeated], rows[b][nearest[repeated]]
            step = thin.states[end] - thin.states[start]
            step[:, wraps] = wrap_angle(step[:, wraps])
            states.append(thin.states[start] + share[:, None] * step)
            strain.append(thin.strain[start] + share[:, None] * (thin.strain[end] - thin.strain[start]))
            sweep.append(thin.sweep[start])
    return replace(
        scan, states=np.concatenate(states), strain=np.concatenate(strain), sweep=np.concatenate(sweep)
    )


def _spacing(scan: Scan, scene: Scene) -> float:
    """Median distance from a pair to the nearest one of another sweep, in shares of the scene's extents."""
    return float(np.median(nearest_of_other_sweeps(scan, scene)[2]))


def _thinned(scaled: np.ndarray, sweep: np.ndarray, step: float) -> np.ndarray:
    """Indices of the pairs that are the first of their sweep after each ``step`` of its way."""
    kept = []
    for number in np.unique(sweep):
        own = np.flatnonzero(sweep == number)
        way = np.cumsum(np.linalg.norm(np.diff(scaled[own], axis=0, prepend=scaled[own[:1]]), axis=1))
        kept.append(own[np.unique(np.floor(way / step), return_index=True)[1]])
    return np.concatenate(kept)


def _apart(one: cKDTree, other: cKDTree) -> float:
    """A lower limit of the distance between two sweeps: that of the boxes around them."""
    gap = np.maximum(one.mins - other.maxes, other.mins - one.maxes)
    return float(np.linalg.norm(np.maximum(gap, 0.0)))


def _numbered(count: np.ndarray) -> np.ndarray:
    """0, 1, ... count - 1 for each count."""
    return np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
