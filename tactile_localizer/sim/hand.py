"""Two fingertips that squeeze the material against a thumb: palm positions to contact wrenches.

The thumb holds its place; index and middle finger press with a constant torque (paper, Sec. II-A). A
torque loop is not infinitely fast: when a feature lifts a finger, its force overshoots, settles within
a fraction of a second, and through the thumb disturbs the other finger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tactile_localizer.sim.contact import SQUEEZE_N, Contact, contact
from tactile_localizer.sim.deformation import Deformation
from tactile_localizer.sim.material import MODES
from tactile_localizer.sim.noise import rough, smooth

PHALANGES = ("index", "middle")
"""The fingertips with a load cell, in the order of the strain vector."""

OFFSETS_M = np.array([[0.0, 12.7e-3], [0.0, -12.7e-3]])
"""Where the fingertips sit, from the palm, as a scene would have it, (2, 2) m."""

_MOUNTING_ERROR_M = np.array([[0.5e-3, -0.3e-3], [-0.4e-3, 0.4e-3]])
_CELL_DEPTH_M = 8.0e-3
_LOOP_STIFFNESS_N_PER_M = 1500.0
_LOOP_TIME_S = 0.25
_TENDON_FRICTION_N = 0.06
_THROUGH_THUMB = 0.3

_GRIP_BETWEEN = np.array([0.010, 0.010, 0.025e-3, 0.025e-3])
_GRIP_WITHIN = np.array([0.005, 0.005, 0.03e-3, 0.03e-3])
_WANDER_LENGTH_M = 12e-3
"""One sigma of squeeze, friction (shares) and tilt (m): between sweeps, and within one over this length."""

_RUB = 0.012
_RUB_LENGTH_M = 0.4e-3


@dataclass(frozen=True)
class Sliding:
    """How the fingers move over the material in one sweep of n samples.

    Parameters
    ----------
    place : (n, 2) m, palm from the feature's centre
    yaw : (n,) rad, turn of the hand in the material's plane
    direction : (n, 2) unit vectors, which way the fingers slide
    tension : (n,) share by which stick-slip changes the friction
    spacing, dt : m and s between samples
    """

    place: np.ndarray
    yaw: np.ndarray
    direction: np.ndarray
    tension: np.ndarray
    spacing: float
    dt: float


@dataclass(frozen=True)
class _Grip:
    """How firmly a finger holds: squeeze and friction as shares (n,), tilt of the pad as m (n, 2)."""

    squeeze: np.ndarray
    friction: np.ndarray
    tilt: np.ndarray


def feel(
    feature: str, sliding: Sliding, lie: Deformation, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Wrenches on the load cells during a sweep.

    Returns
    -------
    wrench : (n, fingers, 6) Fx, Fy, Fz (N), Mx, My, Mz (N m) at each cell's centre
    departure : (n, fingers, 6) the part that is the feature's doing, without any variation of the grip
    """
    n = len(sliding.place)
    touches = [_touch(feature, sliding, lie, offset) for offset in OFFSETS_M + _MOUNTING_ERROR_M]
    loop_error = _loop_error(np.stack([touch.lift for touch in touches], axis=1), sliding.dt)
    steady = _Grip(np.ones(n), np.ones(n), np.zeros((n, 2)))
    rest = contact("none", MODES[0], np.zeros(n), np.zeros(n))
    bare = _wrench(rest, steady, np.zeros(n), sliding.direction)
    wrenches, departures = [], []
    for touch, error in zip(touches, loop_error.T, strict=True):
        wrenches.append(_wrench(touch, _grip(rng, sliding), error, sliding.direction))
        departures.append(_wrench(touch, steady, np.zeros(n), sliding.direction) - bare)
    return np.stack(wrenches, axis=1), np.stack(departures, axis=1)


def _grip(rng: np.random.Generator, sliding: Sliding) -> _Grip:
    """Draw one finger's grip: no two sweeps over featureless material feel quite the same."""
    n = len(sliding.place)
    wander = smooth(rng, n, 4, _WANDER_LENGTH_M / sliding.spacing)
    between, within = rng.standard_normal(4) * _GRIP_BETWEEN, wander * _GRIP_WITHIN
    squeeze, friction, *tilt = (between + within).T
    rub = _RUB * rough(rng, n, 1, _RUB_LENGTH_M / sliding.spacing)[:, 0]
    return _Grip(1 + squeeze, 1 + friction + rub + sliding.tension, np.stack(tilt, axis=1))


def _touch(feature: str, sliding: Sliding, lie: Deformation, offset: np.ndarray) -> Contact:
    """Contact of one pad, the sheet's modes mixed by their weights."""
    cos, sin = np.cos(sliding.yaw), np.sin(sliding.yaw)
    x, y = (
        sliding.place
        - lie.stretch
        + np.stack([cos * offset[0] - sin * offset[1], sin * offset[0] + cos * offset[1]], axis=1)
    ).T
    mixed = np.zeros((6, len(x)))
    for mode, weight in zip(MODES, lie.weights.T, strict=True):
        if np.any(weight):
            mixed += weight * contact(feature, mode, x, y).as_array()
    return Contact(*mixed)


def _loop_error(lift: np.ndarray, dt: float) -> np.ndarray:
    """Force (n, fingers) that the torque loop fails to keep away while the fingers are lifted, N."""
    keep = np.exp(-dt / _LOOP_TIME_S)
    settled = lfilter([1 - keep], [1.0, -keep], lift, axis=0)
    own = _LOOP_STIFFNESS_N_PER_M * (lift - settled)
    own += _TENDON_FRICTION_N * np.tanh(np.gradient(settled, dt, axis=0) / 0.1e-3)
    return np.asarray(own - _THROUGH_THUMB * own[:, ::-1])


def _wrench(touch: Contact, grip: _Grip, loop_error: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Wrench (n, 6) at the cell's centre of one finger's contact."""
    force = SQUEEZE_N * grip.squeeze + loop_error
    friction = touch.friction * grip.friction
    fx = -force * (friction * direction[:, 0] + touch.slope_x)
    fy = -force * (friction * direction[:, 1] + touch.slope_y)
    x, y = touch.center_x + grip.tilt[:, 0], touch.center_y + grip.tilt[:, 1]
    mx = y * force - _CELL_DEPTH_M * fy
    my = -x * force + _CELL_DEPTH_M * fx
    return np.stack([fx, fy, force, mx, my, x * fy - y * fx], axis=1)
