"""Kernel widths of the paper's models, in position the spacing of the lines, in strain from their difference.

The paper sets S_x and S_z by hand (III-C).
"""

import reprlib
from typing import Any

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.lines import differences_between_lines, line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import Tracks
from tactile_localizer.errors import ParameterError
from tactile_localizer.quantity import number
from tactile_localizer.scene import Scene

_POSITION_PER_SPACING = 0.8
"""Kernel width in position, in spacings of the lines."""
_MIN_POSITION_STD = 0.001
"""m: least width in position, for sweeps over one line."""
_RANGE = (1e-12, 1e12)
"""Least and largest width, far beyond any sensor; sums of their squares and reciprocals are finite."""


def kernel_widths(
    scan: Scan, scene: Scene, position_std: Any = None, strain_std: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Kernel widths (d,), m (yaw: rad), and (C,), V; that in strain is the median between neighbouring lines.

    Parameters
    ----------
    scan, scene : training pairs and scene
    position_std, strain_std : widths that are given, one number or one per axis or channel; ``None``: chosen

    Raises
    ------
    ParameterError
        A width that is not positive, or not as many as axes or channels.
    """
    position = _given(position_std, "position_std", scene.dimension)
    strain = _given(strain_std, "strain_std", scene.layout.size)
    if position is None or strain is None:
        tracks, felt = Tracks.of(scan, scene), scan.strain_on(scene)
    if position is None:
        position = max(_POSITION_PER_SPACING * line_spacing(tracks), _MIN_POSITION_STD) / levers(scene)
    if strain is None:
        differences = differences_between_lines(tracks)
        difference = np.median(differences, axis=0) if len(differences) else np.zeros(felt.shape[1])
        # A positive width also for a channel in which most sweeps agree exactly.
        least = 1e-3 * felt.std(axis=0) + 1e-12 * np.abs(felt).max(axis=0) + 1e-30
        strain = np.maximum(difference, least)
    return position, strain


def _given(widths: Any, what: str, count: int) -> np.ndarray | None:
    """Widths (count,) from one number, or one for each; ``None`` from ``None``."""
    if widths is None:
        return None
    given = np.array(widths, dtype=object, ndmin=1)
    if given.ndim > 1 or len(given) not in (1, count):
        raise ParameterError(f"{what}: expected one number or {count}, got {reprlib.repr(widths)}")
    lower, upper = _RANGE
    return np.broadcast_to([number(each, what, lower=lower, upper=upper) for each in given], count)
