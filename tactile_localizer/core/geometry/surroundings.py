"""The part of a scene in which a hand is localized."""

import math
from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.scene import Scene

_SURROUNDINGS = 0.05
"""m around a scan in which a hand is localized."""
_BEYOND = 0.001
"""m beyond a scan that a hand is still on the map, as its position has errors."""


def surroundings(scene: Scene, positions: np.ndarray) -> Scene:
    """The scene in which a hand is localized that was scanned at ``positions`` (n, d).

    Its bounds are those given, but at least :data:`_BEYOND` and at most :data:`_SURROUNDINGS` around the
    positions within them. Those of yaw are not widened, and full-turn axes remain whole.
    """
    scale, axes = levers(scene), []
    for axis, wraps, lever, along in zip(scene.axes, scene.wraps, scale, positions.T, strict=True):
        if not wraps:
            inside, most = along.clip(axis.lower, axis.upper), _SURROUNDINGS / lever
            first, last = float(inside.min()), float(inside.max())
            least = -math.inf if axis.name == "yaw" else _BEYOND
            lower = max(min(axis.lower, first - least), first - most)
            upper = min(max(axis.upper, last + least), last + most)
            axis = replace(axis, lower=lower, upper=upper)
        axes.append(axis)
    return replace(scene, axes=tuple(axes))
