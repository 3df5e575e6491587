"""Many states at once: evaluate a smooth function on a grid over them and interpolate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage

_NODES_PER_WIDTH = 4.0
_MOST_NODES = 2**18
_MARGIN = 6
"""Nodes beyond the states: a spline's end condition fades by 0.27 a node, so 4e-4 of it is left."""


def interpolated(
    states: np.ndarray,
    width: np.ndarray,
    at_states: Callable[[np.ndarray], np.ndarray],
    on_axes: Callable[[list[np.ndarray]], np.ndarray],
) -> np.ndarray:
    """A function of state, smooth on a scale of ``width`` (d,), at states (P, d): (P,).

    Where a grid of four nodes a width over the states has fewer nodes than ten times P, the function is
    evaluated there and interpolated by cubic splines; otherwise at each state. The function is a
    log-likelihood, whose tails are parabolas: cubic splines follow them exactly.
    """
    low = states.min(axis=0)
    counts = np.ceil((states.max(axis=0) - low) / width * _NODES_PER_WIDTH).astype(np.int64) + 2 * _MARGIN + 1
    nodes = float(np.prod(counts.astype(np.float64)))
    if nodes > min(10.0 * len(states), _MOST_NODES):
        return at_states(states)
    spacing = width / _NODES_PER_WIDTH
    start = low - _MARGIN * spacing
    axes = [start[axis] + spacing[axis] * np.arange(count) for axis, count in enumerate(counts)]
    coordinates = ((states - start) / spacing).T
    return ndimage.map_coordinates(on_axes(axes), coordinates, order=3, mode="mirror")
