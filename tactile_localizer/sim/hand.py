"""Contact wrenches of two fingertips that press the material against the thumb while the palm moves.

The thumb is fixed; index and middle finger press with constant torque (paper, Sec. II-A). The bandwidth of
the torque loop is finite: when a feature lifts a finger, its force overshoots, settles within a fraction
of a second, and disturbs the other finger through the thumb.
"""

from dataclasses import dataclass

import numpy as np

from tactile_localizer.sim.contact import SQUEEZE_N, Contact, contact
from tactile_localizer.sim.deformation import Deformation
from tactile_localizer.sim.material import MODES
from tactile_localizer.sim.noise import recursion, rough, smooth

PHALANGES = ("index", "middle")
"""Fingertips with a load cell, in the order of the strain vector."""

OFFSETS_M = np.array([[0.0, 12.7e-3], [0.0, -12.7e-3]])
"""Nominal offsets of the fingertips from the palm, as in a scene, (2, 2) m."""

_MOUNTING_ERROR_M = np.array([[0.5e-3, -0.3e-3], [-0.4e-3, 0.4e-3]])
"""Deviation of the true from the nominal offsets, (2, 2) m."""

_CELL_DEPTH_M = 8.0e-3
"""Distance of a load cell's centre from the surface of the pad, m."""

_LOOP_STIFFNESS_N_PER_M = 1500.0
_LOOP_TIME_S = 0.25
"""Stiffness of the torque loop against fast lifts, and its settling time constant."""

_TENDON_FRICTION_N = 0.06
_THUMB_COUPLING = 0.3
"""Fraction of a finger's force error that acts on the other finger with opposite sign."""

_GRIP_STD_BETWEEN_SWEEPS = np.array([0.010, 0.010, 0.025e-3, 0.025e-3])
_GRIP_STD_WITHIN_SWEEP = np.array([0.005, 0.005, 0.03e-3, 0.03e-3])
"""Standard deviations of squeeze and friction (relative) and of the tilt along x and y (m)."""

_GRIP_LENGTH_M = 12e-3
"""Correlation length of the grip within a sweep, m."""

_RUBBING_STD = 0.012
_RUBBING_LENGTH_M = 0.4e-3
"""Relative standard deviation and correlation length (m) of fast variations of the friction."""


@dataclass(frozen=True)
class Sliding:
    """Motion of the fingers over the material in one sweep of n samples.

    Parameters
    ----------
    position : (n, 2) palm position relative to the feature's centre, m
    yaw : (n,) rotation of the hand in the plane of the material, rad
    direction : (n, 2) unit vectors of the sliding direction
    tension : (n,) relative change of the friction by stick-slip
    spacing, dt : distance (m) and time (s) between samples
    heading : rotation by which the load cells are turned too, rad; that the hand deviates from it by less
        than a degree is neglected there, where it is 1 % of a shear force
    """

    position: np.ndarray
    yaw: np.ndarray
    direction: np.ndarray
    tension: np.ndarray
    spacing: float
    dt: float
    heading: float = 0.0


@dataclass(frozen=True)
class _Grip:
    """Grip of a finger: squeeze and friction relative to nominal (n,), shift of pressure by tilt (n, 2) m."""

    squeeze: np.ndarray
    friction: np.ndarray
    tilt: np.ndarray


def contact_wrenches(
    feature: str, sliding: Sliding, deformed: Deformation, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Wrenches on the load cells during a sweep.

    Returns
    -------
    wrench : (n, fingers, 6) Fx, Fy, Fz (N), Mx, My, Mz (N m) at each cell's centre
    departure : (n, fingers, 6) contribution of the feature, without any variation of the grip
    """
    n = len(sliding.position)
    touches = [_touch(feature, sliding, deformed, offset) for offset in OFFSETS_M + _MOUNTING_ERROR_M]
    loop_error = _loop_error(np.stack([touch.lift for touch in touches], axis=1), sliding.dt)
    steady = _Grip(np.ones(n), np.ones(n), np.zeros((n, 2)))
    rest = contact("none", MODES[0], np.zeros(n), np.zeros(n))
    bare = _wrench(rest, steady, np.zeros(n), sliding.direction)
    wrenches, departures = [], []
    for touch, error in zip(touches, loop_error.T, strict=True):
        wrenches.append(_wrench(touch, _grip(rng, sliding), error, sliding.direction))
        departures.append(_wrench(touch, steady, np.zeros(n), sliding.direction) - bare)
    cells = np.stack(wrenches, axis=1), np.stack(departures, axis=1)
    return cells[0] @ _turn(sliding.heading), cells[1] @ _turn(sliding.heading)


def _turn(heading: float) -> np.ndarray:
    """Matrix (6, 6) by which rows of wrenches along the material's axes become those along a cell's."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.kron(np.eye(2), [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _grip(rng: np.random.Generator, sliding: Sliding) -> _Grip:
    """Draw the grip of one finger, which differs between sweeps and varies within one."""
    n = len(sliding.position)
    variation = smooth(rng, n, 4, _GRIP_LENGTH_M / sliding.spacing)
    between = rng.standard_normal(4) * _GRIP_STD_BETWEEN_SWEEPS
    squeeze, friction, *tilt = (between + variation * _GRIP_STD_WITHIN_SWEEP).T
    rubbing = _RUBBING_STD * rough(rng, n, 1, _RUBBING_LENGTH_M / sliding.spacing)[:, 0]
    return _Grip(1 + squeeze, 1 + friction + rubbing + sliding.tension, np.stack(tilt, axis=1))


def _touch(feature: str, sliding: Sliding, deformed: Deformation, offset: np.ndarray) -> Contact:
    """Contact of one pad, averaged over the deformation modes by their weights."""
    cos, sin = np.cos(sliding.yaw), np.sin(sliding.yaw)
    x, y = (
        sliding.position
        - deformed.stretch
        + np.stack([cos * offset[0] - sin * offset[1], sin * offset[0] + cos * offset[1]], axis=1)
    ).T
    mixed = np.zeros((6, len(x)))
    for mode, weight in zip(MODES, deformed.weights.T, strict=True):
        if np.any(weight):
            mixed += weight * np.stack(contact(feature, mode, x, y))
    return Contact(*mixed)


def _loop_error(lift: np.ndarray, dt: float) -> np.ndarray:
    """Force error (n, fingers) of the torque loop while the fingers are lifted, N."""
    keep = np.exp(-dt / _LOOP_TIME_S)
    settled = recursion((1 - keep) * lift, keep)
    error = _LOOP_STIFFNESS_N_PER_M * (lift - settled)
    error += _TENDON_FRICTION_N * np.tanh(np.gradient(settled, dt, axis=0) / 0.1e-3)
    return np.asarray(error - _THUMB_COUPLING * error[:, ::-1])


def _wrench(touch: Contact, grip: _Grip, loop_error: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Wrench (n, 6) of one finger's contact at the centre of its load cell."""
    force = SQUEEZE_N * grip.squeeze + loop_error
    friction = touch.friction * grip.friction
    fx = -force * (friction * direction[:, 0] + touch.slope_x)
    fy = -force * (friction * direction[:, 1] + touch.slope_y)
    x, y = touch.center_x + grip.tilt[:, 0], touch.center_y + grip.tilt[:, 1]
    mx = y * force - _CELL_DEPTH_M * fy
    my = -x * force + _CELL_DEPTH_M * fx
    return np.stack([fx, fy, force, mx, my, x * fy - y * fx], axis=1)
