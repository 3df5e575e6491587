"""Kernel density of the strain given the position, interpolated where there are many states."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.kernels.background import FLOOR, Background
from tactile_localizer.core.likelihood.kernels.grid import box
from tactile_localizer.core.likelihood.kernels.sums import KernelSum

_LARGEST_EXPONENT = 600.0
"""Magnitude of an exponent up to which its exponential neither overflows nor underflows."""
_NODES_PER_WIDTH = 3.5
_NODES_PER_STATE = 15
"""Grid nodes that cost as much as one state evaluated directly."""
_FEWEST_STATES = 150
"""Number of states that cost as much as the interpolation itself."""
_MOST_NODES = 2**18
_MARGIN = 6
"""Nodes beyond the states: the effect of a spline's end condition falls by 0.27 per node, to 4e-4."""


class KernelDensity:
    """Kernel density of the strain given the position, with the background as its floor.

    .. math:: p(z | x) = (S(x, z) + a\\, b(z)) / (D(x) + a)

    where S is the sum over pairs of position kernel times strain kernel, D the sum of the position kernel
    alone and b the :class:`Background`. ``a`` is :data:`FLOOR` times the D of an evenly spread scan, so that
    the background alone remains where nothing was scanned. ``conditional=False`` is the paper's form with
    constant P(x), where D is that of an evenly spread scan everywhere.

    Parameters
    ----------
    positions, strain : (N, d) m (yaw: rad) and (N, C) V, the training pairs
    position_std, strain_std : (d,) and (C,) kernel widths
    wraps : (d,) bool, axes that are a full turn
    layout : channels of the strain by phalanx
    conditional : whether to divide by D(x)
    evaluation, precision : as for :class:`.KernelSum`
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        position_std: np.ndarray,
        strain_std: np.ndarray,
        wraps: np.ndarray,
        layout: ChannelLayout,
        *,
        conditional: bool = True,
        evaluation: str = "field",
        precision: str = "float64",
    ) -> None:
        self.background = Background(strain, strain_std, layout)
        self._sums = KernelSum(
            positions, strain, position_std, strain_std, wraps, layout, evaluation, precision
        )
        self._conditional = conditional
        kernel = position_std * math.sqrt(2.0 * math.pi)
        low, high = box(positions)
        self._typical = len(positions) * float(np.prod(kernel / np.maximum(high - low, kernel)))

    def log_density(self, states: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-density (P,) of a strain (C,) of the phalanges ``present`` (F,) at states (P, d)."""
        log_floor = math.log(FLOOR * self._typical) + self.background.log_density(strain, present)

        def at_states(points: np.ndarray) -> np.ndarray:
            return self._mix(*self._sums.at_states(points, strain, present, log_floor), log_floor)

        def on_axes(axes: list[np.ndarray]) -> np.ndarray:
            return self._mix(*self._sums.on_axes(axes, strain, present, log_floor), log_floor)

        if self._sums.evaluation == "field":
            return interpolated(states, self._sums.position_std, at_states, on_axes)
        return at_states(states)

    def _mix(self, sums: np.ndarray, density: np.ndarray, log_scale: float, log_floor: float) -> np.ndarray:
        floor = FLOOR * self._typical
        scanned = (density if self._conditional else self._typical) + floor
        if abs(log_floor - log_scale) < _LARGEST_EXPONENT:
            return np.log((sums + math.exp(log_floor - log_scale)) / scanned) + log_scale
        with np.errstate(divide="ignore"):
            return np.logaddexp(np.log(sums) + log_scale, log_floor) - np.log(scanned)


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
