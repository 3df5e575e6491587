"""Display units and axes of figures: mm with inches on the opposite side, degrees for yaw."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_localizer.scene import Scene

if TYPE_CHECKING:  # importing matplotlib takes a second, which users of the units alone save
    from matplotlib.axes import Axes

MM = 1e3
"""Millimetres per metre."""

INCH_MM = 25.4
"""Millimetres per inch."""


def display_units(axis: str, values: np.ndarray) -> np.ndarray:
    """Positions on an axis of the state in display units: mm, degrees for yaw."""
    return np.degrees(values) if axis == "yaw" else np.asarray(values) * MM


def describe_sizes(scene: Scene, sizes: np.ndarray) -> str:
    """Lengths (d,) by axis, m (yaw: rad), as text in display units."""
    return ", ".join(
        f"{axis} {display_units(axis, size):.2f}{'°' if axis == 'yaw' else ' mm'}"
        for axis, size in zip(scene.axis_names, sizes, strict=True)
    )


def literal(text: str) -> str:
    """Text with escaped dollar signs, which matplotlib would read as a formula."""
    return text.replace("$", r"\$")


def label_axis(plot: Axes, which: str, axis: str, *, inches: bool = True, label: bool = True) -> None:
    """Label a plot's axis with an axis of the state, in mm, and add inches on the opposite side.

    Parameters
    ----------
    plot : plot of values in display units (:func:`display_units`)
    which : axis of the plot, ``"x"`` or ``"y"``
    axis : name of the axis of the state
    inches : whether to label the opposite side
    label : whether to label the near side
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
