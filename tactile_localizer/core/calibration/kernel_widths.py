"""Kernel widths of the paper's models, from the distance between lines and the difference of their strains.

The paper sets S_x and S_z by hand (III-C).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.lines import neighbours_on_other_lines
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_POSITION_PER_DISTANCE = 1.0
"""Kernel width in position, in median distances to the next line. Of 0.5, 0.7 and 1 with 0.5 and 0.7 of the
next, the best pair on three simulated features, two seeds each."""
_STRAIN_PER_DIFFERENCE = 0.7
"""Kernel width in strain, in median differences between the strains of neighbouring lines."""
_MIN_POSITION_STD = 0.001
"""m: least width in position, for sweeps that run over each other."""
_MAX_RATIO = 8.0
"""Ratio of a given width to the one chosen here, or its inverse, above which the given one is reported: a
variance in place of a standard deviation, or millimetres, are off by more. By judgement."""


def choose_kernel_widths(scan: Scan, scene: Scene, given: ModelParameters) -> ModelParameters:
    """Complete the given parameters by the widths that are ``None``.

    Raises
    ------
    ScanError
        The scan is a single pair.
    """
    own, nearest, distance = neighbours_on_other_lines(scan, scene)
    strain = scan.strain_on(scene)
    difference = np.median(np.abs(strain[own] - strain[nearest]), axis=0)
    # A positive width also for a channel in which most sweeps agree exactly.
    least = 1e-3 * strain.std(axis=0) + 1e-12 * np.abs(strain).max(axis=0) + 1e-30
    position_std = max(_POSITION_PER_DISTANCE * float(np.median(distance)), _MIN_POSITION_STD)
    widths = {
        "position_std": position_std / levers(scene),
        "strain_std": _STRAIN_PER_DIFFERENCE * np.maximum(difference, least),
    }
    return replace(given, **{name: width for name, width in widths.items() if getattr(given, name) is None})


def describe_unfit_widths(scan: Scan, scene: Scene) -> str | None:
    """Warning where kernel widths in ``scene`` are far from those that fit the scan, or ``None``."""
    given, fitting = ModelParameters.of_scene(scene), choose_kernel_widths(scan, scene, ModelParameters())
    found, expected = [], []
    for name, unit in (("position_std", "m"), ("strain_std", "V")):
        width, usual = getattr(given, name), getattr(fitting, name)
        ratio = 1.0 if width is None else float(np.median(np.asarray(width) / usual))
        if abs(math.log(ratio)) > math.log(_MAX_RATIO):
            found.append(f"{name} {np.median(width):.2g} {unit}")
            expected.append(f"{name} {np.median(usual):.2g} {unit}")
    if not found:
        return None
    return (
        f"measurement of scene {scene.name}: expected kernel widths that fit the scan (about "
        f"{', '.join(expected)}), found {', '.join(found)}; omitted widths are chosen from the scan"
    )
