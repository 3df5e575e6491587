"""Kernel widths of the paper's models, in position the spacing of the lines, in strain from their difference.

The paper sets S_x and S_z by hand (III-C).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.lines import differences_between_lines, line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import Tracks
from tactile_localizer.scene import Scene

_POSITION_PER_SPACING = 0.8
"""Kernel width in position, in spacings of the lines."""
_MIN_POSITION_STD = 0.001
"""m: least width in position, for sweeps over one line."""


def choose_kernel_widths(scan: Scan, scene: Scene, given: ModelParameters) -> ModelParameters:
    """Complete the given parameters by the widths that are ``None``.

    That in strain is the median difference between the strains of neighbouring lines.
    """
    tracks, strain = Tracks.of(scan, scene), scan.strain_on(scene)
    differences = differences_between_lines(tracks)
    difference = np.median(differences, axis=0) if len(differences) else np.zeros(strain.shape[1])
    # A positive width also for a channel in which most sweeps agree exactly.
    least = 1e-3 * strain.std(axis=0) + 1e-12 * np.abs(strain).max(axis=0) + 1e-30
    widths = {
        "position_std": max(_POSITION_PER_SPACING * line_spacing(tracks), _MIN_POSITION_STD) / levers(scene),
        "strain_std": np.maximum(difference, least),
    }
    return replace(given, **{name: width for name, width in widths.items() if getattr(given, name) is None})
