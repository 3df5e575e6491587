"""Evaluation of a smooth function at many states, by interpolation on a grid over them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from tactile_localizer.core.likelihood.kernels.grid import box

_NODES_PER_WIDTH = 3.5
_NODES_PER_STATE = 15
"""Grid nodes that cost as much as one state evaluated directly."""
_FEWEST_STATES = 150
"""Number of states that cost as much as the interpolation itself."""
_MOST_NODES = 2**18
_MARGIN = 6
"""Nodes beyond the states: the effect of a spline's end condition falls by 0.27 per node, to 4e-4."""


def interpolated(
    states: np.ndarray,
    width: np.ndarray,
    at_states: Callable[[np.ndarray], np.ndarray],
    on_axes: Callable[[list[np.ndarray]], np.ndarray],
) -> np.ndarray:
    """Values (P,) at states (P, d) of a function that is smooth on a scale of ``width`` (d,).

    Where it is less work, the function is evaluated on a grid of 3.5 nodes per width and interpolated by
    cubic splines. The function is a log-likelihood, whose parabolic tails cubic splines reproduce exactly.

    Parameters
    ----------
    at_states, on_axes : evaluate the function at states (P, d), and on a grid given by the coordinates of d
        axes
    """
    most_nodes = min(_NODES_PER_STATE * (len(states) - _FEWEST_STATES), _MOST_NODES)
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
