"""Flexible material with one haptic feature, as fields of height, stiffness and friction.

Coordinates are those of the material with the feature's centre as origin, m; the fingers slide
towards +x. A sheet does not lie the same way twice: it comes to a feature in one of several
deformation modes (paper, Sec. III-C and Fig. 6), each with fields of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from tactile_localizer.errors import ParameterError

PAD_STIFFNESS = 3.5e7
"""N/m^3, foundation modulus of a fingertip pad; the material's stiffness is given relative to it."""

MODES = ("taut", "wrinkled", "canted")
"""How the sheet lies as the fingers come to the feature; the first is the rest shape."""

_EDGE_M = 0.35e-3
"""Roundness of the features' edges: a step of height is spread over about four times this."""


@dataclass(frozen=True)
class Surface:
    """What a pad finds at each place: three arrays of one shape.

    Parameters
    ----------
    height : m above the bare sheet
    stiffness : N/m^3, foundation modulus
    friction : coefficient of sliding friction against the pad
    """

    height: np.ndarray
    stiffness: np.ndarray
    friction: np.ndarray


def _inside(distance: np.ndarray, limit: float) -> np.ndarray:
    """1 where ``distance`` < ``limit``, 0 beyond it, with an edge of finite sharpness."""
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
    """A bump pressed into plastic: a stiff rim of 11 mm and a broad soft top that gives way."""
    r = np.hypot(x, y)
    disk, rim = _inside(r, 5.5e-3), _ring(r, 3.9e-3, 5.5e-3)
    dome = np.clip(1 - (r / 5.5e-3) ** 2, 0, None)
    height = 1.3e-3 * disk + 0.4e-3 * dome
    return _surface(height, 3.0 - 2.55 * disk + 1.3 * rim, 0.40 + 0.04 * rim)


def _snap(x: np.ndarray, y: np.ndarray) -> Surface:
    """A snap fastener: a hard narrow stud of 2.6 mm height on a low flange with a raised ring."""
    r = np.hypot(x, y)
    flange, ring, stud = _inside(r, 5.0e-3), _ring(r, 3.8e-3, 5.0e-3), _inside(r, 2.2e-3)
    height = 0.6e-3 * flange + 0.4e-3 * ring + 2.0e-3 * stud
    return _surface(height, 3.0 + 9.0 * flange, 0.40 - 0.18 * flange)


def _grommet(x: np.ndarray, y: np.ndarray) -> Surface:
    """A metal ring of 12 mm around a hole of 5.6 mm that the pad sinks into."""
    r = np.hypot(x, y)
    ring, hole = _ring(r, 2.8e-3, 6.0e-3), _inside(r, 2.8e-3)
    crown = np.clip(1 - ((r - 4.4e-3) / 1.6e-3) ** 2, 0, None)
    height = 0.7e-3 * ring + 0.4e-3 * crown - 0.5e-3 * hole
    return _surface(height, 3.0 + 9.0 * ring - 2.9 * hole, 0.40 - 0.20 * ring)


def _seam(x: np.ndarray, y: np.ndarray) -> Surface:
    """A folded seam across the way, endless in y: a thing that no scan has shown."""
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
"""Names of the features; ``none`` is blank material, ``seam`` something foreign to test against."""


def surface(feature: str, mode: str, x: np.ndarray, y: np.ndarray) -> Surface:
    """Fields of ``feature`` in deformation mode ``mode`` at places ``x``, ``y``.

    Parameters
    ----------
    feature : one of :data:`FEATURES`
    mode : one of :data:`MODES`; blank material has no other than ``taut``
    x, y : m from the feature's centre, shapes that broadcast

    Raises
    ------
    ParameterError
        No such feature or mode.
    """
    if feature not in _FEATURES:
        raise ParameterError(f"feature {feature!r}: expected one of {', '.join(FEATURES)}")
    if mode not in MODES:
        raise ParameterError(f"deformation mode {mode!r}: expected one of {', '.join(MODES)}")
    shape = _FEATURES[feature]
    if mode == "taut" or feature == "none":
        return shape(x, y)
    if mode == "wrinkled":
        return _wrinkled(shape(x, y), x, y)
    return _canted(shape(x - 0.8e-3, y), x)


def _wrinkled(rest: Surface, x: np.ndarray, y: np.ndarray) -> Surface:
    """A soft fold, pushed up in front of the feature and lying obliquely, that is in the pad's way first."""
    across = (x + 5.8e-3) * np.cos(0.2) + y * np.sin(0.2)
    fold = np.exp(-0.5 * (across / 1.1e-3) ** 2 - 0.5 * (y / 6.0e-3) ** 2)
    hardness = rest.stiffness * (1 - 0.8 * fold)
    return Surface(np.maximum(rest.height, 1.5e-3 * fold), hardness, rest.friction + 0.1 * fold)


def _canted(rest: Surface, x: np.ndarray) -> Surface:
    """The feature leans away from the hand: its near edge lies in the sheet, its far edge stands up."""
    lean = np.clip(1 + x / 7.0e-3, 0.25, 1.6)
    return Surface(rest.height * lean, rest.stiffness, rest.friction)
