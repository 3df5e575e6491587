"""What a fingertip pad feels of a feature, for every place of the pad: a table, solved once.

The pad is an elastic foundation under a curved cap, pressed on by a constant force (torque control).
At each place the cap's lift follows from the balance of forces; where the pressure then lies gives
the centre of pressure, the slope climbed and the friction. The material's own stiffness acts in series.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from tactile_localizer.sim.material import PAD_STIFFNESS, surface

SQUEEZE_N = 4.0
"""Force with which each finger presses the material against the thumb, N."""

PAD_HALF_M = (7.5e-3, 9.5e-3)
"""Half axes of a pad along x and y, m: the size of a human fingertip."""

_CAP_RADII_M = (30e-3, 45e-3)
_STEP_M = 0.5e-3
_PLACE_STEPS = 2
_REACH = 20
_NEWTON_STEPS = 8


@dataclass(frozen=True)
class Contact:
    """A pad's contact at n places, (n,) each.

    Parameters
    ----------
    lift : m that the finger is pushed back, from its rest on the bare sheet
    center_x, center_y : m, centre of pressure from the middle of the pad
    slope_x, slope_y : pressure-weighted mean slope of the surface under the pad
    friction : pressure-weighted mean friction
    """

    lift: np.ndarray
    center_x: np.ndarray
    center_y: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray
    friction: np.ndarray

    def as_array(self) -> np.ndarray:
        """The six quantities as rows, (6, n)."""
        return np.stack([self.lift, self.center_x, self.center_y, self.slope_x, self.slope_y, self.friction])


def contact(feature: str, mode: str, x: np.ndarray, y: np.ndarray) -> Contact:
    """Contact of a pad whose middle is at ``x``, ``y`` (n,), m from the feature's centre.

    Raises
    ------
    ParameterError
        No such feature or mode.
    """
    where = np.stack([x, y]) / (_PLACE_STEPS * _STEP_M) + _REACH
    table = _table(feature, mode)
    return Contact(
        *(map_coordinates(field, where, order=3, mode="nearest", prefilter=False) for field in table)
    )


@cache
def _table(feature: str, mode: str) -> np.ndarray:
    """Spline coefficients of the six fields on a square of places, (6, places, places)."""
    pad = [np.arange(-np.ceil(half / _STEP_M), np.ceil(half / _STEP_M) + 1) for half in PAD_HALF_M]
    u, v = np.meshgrid(*pad, indexing="ij")
    in_pad = (u * _STEP_M / PAD_HALF_M[0]) ** 2 + (v * _STEP_M / PAD_HALF_M[1]) ** 2 <= 1
    u, v = u[in_pad].astype(int), v[in_pad].astype(int)

    margin = _REACH * _PLACE_STEPS + max(len(axis) for axis in pad) // 2
    line = np.arange(-margin, margin + 1) * _STEP_M
    material = surface(feature, mode, line[:, None], line[None, :])
    stiffness = 1 / (1 / PAD_STIFFNESS + 1 / material.stiffness)
    slope_x, slope_y = np.gradient(material.height, _STEP_M)
    fields = np.stack([material.height, stiffness, slope_x, slope_y, material.friction])

    cap = -((u * _STEP_M) ** 2 / (2 * _CAP_RADII_M[0]) + (v * _STEP_M) ** 2 / (2 * _CAP_RADII_M[1]))
    places = margin + _PLACE_STEPS * np.arange(-_REACH, _REACH + 1)
    rows = [
        _balance(fields[:, row + u, places[:, None] + v], cap, u * _STEP_M, v * _STEP_M) for row in places
    ]
    table = np.stack(rows, axis=1)
    table[0] -= _rest_lift(cap)
    return np.stack([spline_filter(field) for field in table])


def _balance(fields: np.ndarray, cap: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Contact at n places under the squeeze: ``fields`` (5, n, Q) under the pad's Q points; gives (6, n).

    Newton's method on the balance of forces, which is piecewise linear and convex in the lift, so that
    a start from below with every point in touch arrives at the answer in a few exact steps.
    """
    height, stiffness, slope_x, slope_y, friction = fields
    stiffness = stiffness * _STEP_M**2
    gap = height + cap
    touching = np.ones_like(gap)
    for _ in range(_NEWTON_STEPS):
        spring = stiffness * touching
        lift = (np.sum(spring * gap, axis=1) - SQUEEZE_N) / np.sum(spring, axis=1)
        touching = gap > lift[:, None]
    force = stiffness * np.clip(gap - lift[:, None], 0, None)
    force /= np.sum(force, axis=1, keepdims=True)
    means = [np.sum(force * of, axis=1) for of in (u, v, slope_x, slope_y, friction)]
    return np.stack([lift, *means])


def _rest_lift(cap: np.ndarray) -> float:
    """Lift of a pad on the bare sheet, m (negative: it sinks in)."""
    sheet = surface("none", "taut", np.zeros_like(cap), np.zeros_like(cap))
    fields = np.stack([sheet.height, 1 / (1 / PAD_STIFFNESS + 1 / sheet.stiffness), cap, cap, sheet.friction])
    return float(_balance(fields[:, None, :], cap, cap, cap)[0, 0])
