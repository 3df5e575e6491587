"""Quasi-static contact of a fingertip pad with a feature, tabulated over the position of the pad.

The pad is an elastic foundation under a curved cap, pressed on with constant force (torque control). At
each position the lift of the cap follows from the balance of forces, and the pressure distribution gives
the centre of pressure, the mean slope and the mean friction. The stiffness of the material acts in series.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from tactile_localizer.sim.material import PAD_STIFFNESS, surface

SQUEEZE_N = 4.0
"""Force with which each finger presses the material against the thumb, N."""

PAD_HALF_M = (7.5e-3, 9.5e-3)
"""Half axes of a pad along x and y, m: the size of a human fingertip."""

_CAP_RADII_M = (30e-3, 45e-3)
"""Radii of curvature of a pad's cap along x and y, m."""

_GRID_STEP_M = 0.5e-3
"""Spacing of the points under the pad, m: a third of the features' edge width."""

_TABLE_STRIDE = 2
"""Spacing of the tabulated positions, in grid steps."""

_TABLE_HALF_SIZE = 20
"""Tabulated positions on each side of the feature; 20 mm, three times the radius of a feature."""

_NEWTON_STEPS = 8
"""Iterations of Newton's method; more do not change the table."""


class Contact(NamedTuple):
    """Contact of a pad at n positions, (n,) each.

    Parameters
    ----------
    lift : displacement of the finger from its rest on the bare sheet, m
    center_x, center_y : centre of pressure relative to the middle of the pad, m
    slope_x, slope_y : pressure-weighted mean slope of the surface under the pad
    friction : pressure-weighted mean friction
    """

    lift: np.ndarray
    center_x: np.ndarray
    center_y: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray
    friction: np.ndarray


def contact(feature: str, mode: str, x: np.ndarray, y: np.ndarray) -> Contact:
    """Contact of a pad with its middle at ``x``, ``y`` (n,), m, relative to the feature's centre."""
    coordinates = np.stack([x, y]) / (_TABLE_STRIDE * _GRID_STEP_M) + _TABLE_HALF_SIZE
    table = _table(feature, mode)
    return Contact(
        *(map_coordinates(field, coordinates, order=3, mode="nearest", prefilter=False) for field in table)
    )


@cache
def _table(feature: str, mode: str) -> np.ndarray:
    """Spline coefficients of the six quantities on a square grid of n x n positions, (6, n, n)."""
    pad = [np.arange(-np.ceil(half / _GRID_STEP_M), np.ceil(half / _GRID_STEP_M) + 1) for half in PAD_HALF_M]
    u, v = np.meshgrid(*pad, indexing="ij")
    in_pad = (u * _GRID_STEP_M / PAD_HALF_M[0]) ** 2 + (v * _GRID_STEP_M / PAD_HALF_M[1]) ** 2 <= 1
    u, v = u[in_pad].astype(int), v[in_pad].astype(int)

    margin = _TABLE_HALF_SIZE * _TABLE_STRIDE + max(len(axis) for axis in pad) // 2
    line = np.arange(-margin, margin + 1) * _GRID_STEP_M
    material = surface(feature, mode, line[:, None], line[None, :])
    stiffness = 1 / (1 / PAD_STIFFNESS + 1 / material.stiffness)
    slope_x, slope_y = np.gradient(material.height, _GRID_STEP_M)
    fields = np.stack([material.height, stiffness, slope_x, slope_y, material.friction])

    cap = -((u * _GRID_STEP_M) ** 2 / (2 * _CAP_RADII_M[0]) + (v * _GRID_STEP_M) ** 2 / (2 * _CAP_RADII_M[1]))
    positions = margin + _TABLE_STRIDE * np.arange(-_TABLE_HALF_SIZE, _TABLE_HALF_SIZE + 1)
    rows = [
        _balance(fields[:, row + u, positions[:, None] + v], cap, u * _GRID_STEP_M, v * _GRID_STEP_M)
        for row in positions
    ]
    table = np.stack(rows, axis=1)
    table[0] -= _rest_lift(cap)
    return np.stack([spline_filter(field) for field in table])


def _balance(fields: np.ndarray, cap: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Contact (6, n) at n positions, from the ``fields`` (5, n, Q) under the Q points of the pad.

    Newton's method on the balance of forces. It is piecewise linear and convex in the lift, so iteration
    from below, with all points in contact at first, ends at the exact solution after a few steps.
    """
    height, stiffness, slope_x, slope_y, friction = fields
    stiffness = stiffness * _GRID_STEP_M**2
    gap = height + cap
    touching = np.ones_like(gap)
    for _ in range(_NEWTON_STEPS):
        spring = stiffness * touching
        lift = (np.sum(spring * gap, axis=1) - SQUEEZE_N) / np.sum(spring, axis=1)
        touching = gap > lift[:, None]
    force = stiffness * np.clip(gap - lift[:, None], 0, None)
    force /= np.sum(force, axis=1, keepdims=True)
    means = [np.sum(force * quantity, axis=1) for quantity in (u, v, slope_x, slope_y, friction)]
    return np.stack([lift, *means])


def _rest_lift(cap: np.ndarray) -> float:
    """Lift of a pad on the bare sheet, m; negative because the pad sinks in."""
    sheet = surface("none", "taut", np.zeros_like(cap), np.zeros_like(cap))
    fields = np.stack([sheet.height, 1 / (1 / PAD_STIFFNESS + 1 / sheet.stiffness), cap, cap, sheet.friction])
    return float(_balance(fields[:, None, :], cap, cap, cap)[0, 0])
