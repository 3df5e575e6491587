"""Many states at once: evaluate a smooth function on a grid over them and interpolate."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import ndimage

_NODES_PER_WIDTH = 4.0
_WORTH_NODES = 20.0
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

    Where a grid of four nodes a width over the states has fewer nodes than twenty times P, the function is
    evaluated there and interpolated by cubic splines; otherwise at each state. The function is a
    log-likelihood, whose tails are parabolas: cubic splines follow them exactly.
    """
    low = np.array([coordinates.min() for coordinates in states.T])
    high = np.array([coordinates.max() for coordinates in states.T])
    counts = np.ceil((high - low) / width * _NODES_PER_WIDTH) + (2 * _MARGIN + 1)
    if math.prod(counts) > min(_WORTH_NODES * len(states), _MOST_NODES):
        return at_states(states)
    spacing = width / _NODES_PER_WIDTH
    start = low - _MARGIN * spacing
    axes = [start[axis] + spacing[axis] * np.arange(int(count)) for axis, count in enumerate(counts)]
    coordinates = ((states - start) / spacing).T
    return ndimage.map_coordinates(on_axes(axes), coordinates, order=3, mode="mirror")
