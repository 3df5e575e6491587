"""Flexible material with one haptic feature, as fields of height, stiffness and friction.

Coordinates are relative to the centre of the feature, m; the fingers slide towards +x. The sheet deforms
differently in each sweep: it is in one of several deformation modes (paper, Sec. III-C and Fig. 6), each
with its own fields.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

PAD_STIFFNESS = 3.5e7
"""Foundation modulus of a fingertip pad, N/m³; the stiffness of materials is given relative to it."""

MODES = ("taut", "wrinkled", "canted")
"""Deformation modes of the sheet in front of the feature; the first is the undeformed shape."""

_EDGE_M = 0.35e-3
"""Rounding of the features' edges, m: a step in height extends over about four times this."""


@dataclass(frozen=True)
class Surface:
    """Fields of the material at some positions, three arrays of the same shape.

    Parameters
    ----------
    height : height above the bare sheet, m
    stiffness : foundation modulus, N/m³
    friction : coefficient of sliding friction against the pad
    """

    height: np.ndarray
    stiffness: np.ndarray
    friction: np.ndarray


def _inside(distance: np.ndarray, limit: float) -> np.ndarray:
    """1 for ``distance`` < ``limit``, 0 beyond, with a rounded edge."""
    return np.asarray(expit((limit - distance) / _EDGE_M))


def _ring(distance: np.ndarray, inner: float, outer: float) -> np.ndarray:
    return _inside(distance, outer) - _inside(distance, inner)


def _surface(height: np.ndarray, hardness: np.ndarray, friction: np.ndarray) -> Surface:
    return Surface(height, PAD_STIFFNESS * hardness, friction)


def _none(x: np.ndarray, y: np.ndarray) -> Surface:
    """The bare sheet."""
    flat = np.zeros(np.broadcast(x, y).shape)
    return _surface(flat, flat + 3.0, flat + 0.40)


def _bump(x: np.ndarray, y: np.ndarray) -> Surface:
    """A bump pressed into plastic: a stiff rim of 11 mm diameter and a broad compliant top."""
    r = np.hypot(x, y)
    disk, rim = _inside(r, 5.5e-3), _ring(r, 3.9e-3, 5.5e-3)
    dome = np.clip(1 - (r / 5.5e-3) ** 2, 0, None)
    height = 1.3e-3 * disk + 0.4e-3 * dome
    return _surface(height, 3.0 - 2.55 * disk + 1.3 * rim, 0.40 + 0.04 * rim)


def _snap(x: np.ndarray, y: np.ndarray) -> Surface:
    """A snap fastener: a hard, narrow stud of 2.6 mm height on a low flange with a raised ring."""
    r = np.hypot(x, y)
    flange, ring, stud = _inside(r, 5.0e-3), _ring(r, 3.8e-3, 5.0e-3), _inside(r, 2.2e-3)
    height = 0.6e-3 * flange + 0.4e-3 * ring + 2.0e-3 * stud
    return _surface(height, 3.0 + 9.0 * flange, 0.40 - 0.18 * flange)


def _grommet(x: np.ndarray, y: np.ndarray) -> Surface:
    """A metal ring of 12 mm diameter around a hole of 5.6 mm, into which the pad sinks."""
    r = np.hypot(x, y)
    ring, hole = _ring(r, 2.8e-3, 6.0e-3), _inside(r, 2.8e-3)
    crown = np.clip(1 - ((r - 4.4e-3) / 1.6e-3) ** 2, 0, None)
    height = 0.7e-3 * ring + 0.4e-3 * crown - 0.5e-3 * hole
    return _surface(height, 3.0 + 9.0 * ring - 2.9 * hole, 0.40 - 0.20 * ring)


def _seam(x: np.ndarray, y: np.ndarray) -> Surface:
    """A folded seam across the direction of sliding, infinite in y, for tests with an unknown feature."""
    fold, stitch = _inside(np.abs(x), 3.0e-3), _inside(np.abs(x - 1.5e-3), 0.5e-3)
    height = 0.9e-3 * fold + 0.3e-3 * stitch + 0 * y
    return _surface(height, 3.0 + 2.0 * fold + 0 * y, 0.40 + 0.12 * fold + 0 * y)


_FEATURES: dict[str, Callable[[np.ndarray, np.ndarray], Surface]] = {
    "bump": _bump,
    "snap": _snap,
    "grommet": _grommet,
    "seam": _seam,
    "none": _none,
}

FEATURES = tuple(_FEATURES)
"""Names of the features; ``none`` is featureless material, ``seam`` a feature outside the maps of tests."""

SIMULATED_FEATURES = ("bump", "snap", "grommet")
"""Features with a shipped scene."""


def surface(feature: str, mode: str, x: np.ndarray, y: np.ndarray) -> Surface:
    """Fields of ``feature`` in deformation mode ``mode`` at positions ``x``, ``y``.

    Parameters
    ----------
    feature : one of :data:`FEATURES`
    mode : one of :data:`MODES`; featureless material is always ``taut``
    x, y : positions relative to the feature's centre, m, with shapes that broadcast
    """
    shape = _FEATURES[feature]
    if mode == "taut" or feature == "none":
        return shape(x, y)
    if mode == "wrinkled":
        return _wrinkled(shape(x, y), x, y)
    return _canted(shape(x - 0.8e-3, y), x)


def _wrinkled(rest: Surface, x: np.ndarray, y: np.ndarray) -> Surface:
    """An oblique soft fold in front of the feature, which the pad reaches first."""
    across = (x + 5.8e-3) * np.cos(0.2) + y * np.sin(0.2)
    fold = np.exp(-0.5 * (across / 1.1e-3) ** 2 - 0.5 * (y / 6.0e-3) ** 2)
    hardness = rest.stiffness * (1 - 0.8 * fold)
    return Surface(np.maximum(rest.height, 1.5e-3 * fold), hardness, rest.friction + 0.1 * fold)


def _canted(rest: Surface, x: np.ndarray) -> Surface:
    """The feature tilted: its near edge is in the plane of the sheet, its far edge is raised."""
    lean = np.clip(1 + x / 7.0e-3, 0.25, 1.6)
    return Surface(rest.height * lean, rest.stiffness, rest.friction)
