"""Lengths as people read them in figures: millimetres, with inches beside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # matplotlib takes a second, which those who only want the units need not wait for
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
"""Millimetres in a metre."""

INCH_MM = 25.4
"""Millimetres in an inch."""

_LEGEND_INCH = 0.35
"""Height of the strip that a legend below the plots takes, inch."""


def shown(axis: str, values: np.ndarray) -> np.ndarray:
    """Positions on an axis of the state as figures show them: m in mm, rad in degrees."""
    return np.degrees(values) if axis == "yaw" else np.asarray(values) * MM


def literal(text: str) -> str:
    """A name as matplotlib shows it letter for letter: a dollar sign begins no formula."""
    return text.replace("$", r"\$")


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


def legend_below(figure: Figure, plot: Axes) -> None:
    """Put the legend of one plot in a row below all plots of a figure, where it has any entries.

    Parameters
    ----------
    figure : with constrained layout, which is told to leave room (``"outside"`` needs matplotlib 3.7)
    plot : whose entries are shown
    """
    handles, labels = plot.get_legend_handles_labels()
    if not handles:
        return
    strip = _LEGEND_INCH / figure.get_figheight()
    figure.set_layout_engine("constrained", rect=(0.0, strip, 1.0, 1.0 - strip))
    figure.legend(handles, labels, loc="lower center", ncol=len(handles), frameon=False)
