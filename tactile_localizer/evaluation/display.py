"""Lengths as people read them in figures: millimetres, with inches beside."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

MM = 1e3
"""Millimetres in a metre."""

INCH_MM = 25.4
"""Millimetres in an inch."""


def shown(axis: str, values: np.ndarray) -> np.ndarray:
    """Positions on an axis of the state as figures show them: m in mm, rad in degrees."""
    return np.degrees(values) if axis == "yaw" else np.asarray(values) * MM


def label_axis(plot: Axes, which: str, axis: str, *, inches: bool = True, label: bool = True) -> None:
    """Name a plot's axis after an axis of the state, in mm, and put inches on the opposite side.

    Parameters
    ----------
    plot : shows values of :func:`shown`
    which : ``"x"`` or ``"y"`` of the plot
    axis : name of the state's axis
    inches : whether the opposite side is labelled
    label : whether the near side is labelled
    """
    if label:
        getattr(plot, f"set_{which}label")(f"{axis}, {'degrees' if axis == 'yaw' else 'mm'}")
    if axis == "yaw" or not inches:
        return
    side = "top" if which == "x" else "right"
    beside = getattr(plot, f"secondary_{which}axis")(
        side, functions=(lambda mm: mm / INCH_MM, lambda inch: inch * INCH_MM)
    )
    getattr(beside, f"set_{which}label")(f"{axis}, inch", color="0.4")
    beside.tick_params(colors="0.4")
