"""Units that positions may be in, where they do not fit the scene's bounds in SI units."""

from __future__ import annotations

import numpy as np

from tactile_localizer.scene import Axis

LENGTHS = {"mm": 0.001, "cm": 0.01, "inches": 0.0254}
ANGLES = {"degrees": 0.0174533}
TIMES = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""SI units in one of each unit."""

_FITS = 0.9
"""Share of the positions that a unit has to bring inside the bounds to be proposed."""


def fitting_unit(axis: Axis, values: np.ndarray, units: dict[str, float]) -> tuple[str, float] | None:
    """The unit of ``units`` in which positions on an axis would lie inside its bounds.

    Parameters
    ----------
    axis : its bounds count
    values : (n,) positions as they were recorded
    units : SI units in one of each

    Returns
    -------
    unit, factor : of those that fit, the largest, which fills the bounds best; ``None``: none fits, or the
        values fit as they are
    """
    values = values[np.isfinite(values)]
    if not len(values) or inside(axis, values) >= 0.5:
        return None
    fitting = [(factor, unit) for unit, factor in units.items() if inside(axis, factor * values) >= _FITS]
    return (max(fitting)[1], max(fitting)[0]) if fitting else None


def inside(axis: Axis, values: np.ndarray) -> float:
    """Share of positions (n,) that lie within the axis's bounds."""
    return float(np.mean((values >= axis.lower) & (values <= axis.upper)))
