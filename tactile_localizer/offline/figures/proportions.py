"""Proportions of plots that show the material as it lies, and sizes of figures of them."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from tactile_localizer.scene import Scene

_FLATTEST, _TALLEST = 0.08, 3.0
"""Height by width beyond which a plot no longer has the material's: nothing would be seen in it."""
_NO_PLACE = 0.8
"""Height by width of a plot with an angle, or with one axis of the state."""
_FLAT = 0.4
"""Height by width below which plots stand above each other instead of side by side."""
_TITLE_IN, _LABELS_IN = 0.3, 0.7
"""Space that a title takes above a plot, and the labels of an axis beside and below it, inches."""


def proportion(scene: Scene) -> float:
    """Height by width of plots over the first two axes of a scene."""
    names = scene.axis_names[:2]
    if len(names) < 2 or "yaw" in names:
        return _NO_PLACE
    width, height = scene.extent[:2]
    return float(np.clip(height / width, _FLATTEST, _TALLEST))


def is_flat(scene: Scene) -> bool:
    """Whether the material is a strip along the first axis, of which plots stand above each other."""
    return proportion(scene) < _FLAT


def plan_size(
    scene: Scene, width_in: float, plots: int = 1, columns: int = 1
) -> tuple[int, tuple[float, float]]:
    """Columns, and width and height (inches) of a figure of plots over the first two axes of a scene.

    Parameters
    ----------
    scene : of the material
    width_in : width of the figure, inches
    plots : number of plots
    columns : most plots side by side
    """
    columns = 1 if is_flat(scene) else min(columns, plots)
    each_in = (width_in - _LABELS_IN) / columns
    return columns, (width_in, -(-plots // columns) * (each_in * proportion(scene) + _TITLE_IN) + _LABELS_IN)


def keep_proportions(plot: Axes, axes: Sequence[str]) -> None:
    """Give a plot that has its limits the proportions of the material; not where ``axes`` have a yaw."""
    if "yaw" not in axes[:2]:
        ratio = np.ptp(plot.get_ylim()) / np.ptp(plot.get_xlim())
        plot.set_box_aspect(float(np.clip(ratio, _FLATTEST, _TALLEST)))
