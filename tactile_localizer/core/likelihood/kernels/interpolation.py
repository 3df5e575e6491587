"""Many states at once: evaluate a smooth function on a grid over them and interpolate."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from tactile_localizer.core.likelihood.kernels.grid import box

_NODES_PER_WIDTH = 3.5
_NODES_A_STATE = 15
"""Nodes of the grid that are as much work as one state more than the first :data:`_FEWEST_STATES`."""
_FEWEST_STATES = 150
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

    Where it is less work, the function is evaluated on a grid of three and a half nodes a width over the
    states, and interpolated by cubic splines; otherwise at each state. The function is a log-likelihood,
    whose tails are parabolas: cubic splines follow them exactly.
    """
    most_nodes = min(_NODES_A_STATE * (len(states) - _FEWEST_STATES), _MOST_NODES)
    if most_nodes <= 0:
        return at_states(states)
    low, high = box(states)
    counts = np.ceil((high - low) / width * _NODES_PER_WIDTH).astype(np.int64) + 2 * _MARGIN + 1
    if math.prod(counts.tolist()) > most_nodes:
        return at_states(states)
    spacing = width / _NODES_PER_WIDTH
    start = low - _MARGIN * spacing
    axes = [start[axis] + spacing[axis] * np.arange(count) for axis, count in enumerate(counts)]
    coordinates = ((states - start) / spacing).T
    return ndimage.map_coordinates(on_axes(axes), coordinates, order=3, mode="mirror")
