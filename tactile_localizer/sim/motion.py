"""The arm's sweep and the material's own motion: where the palm is, and where it believes to be.

The material hangs loosely: friction carries it along until it slips, again and again, and it swings
(paper, Sec. II-A). The arm's kinematics do not see that, so the error of the reported displacement
grows like a random walk. Fixtured for training, the material moves less, but it moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tactile_localizer.sim.noise import smooth

_RAMP_S = 0.3
_SPEED_VARIATION = 0.08
_WOBBLE_M = 0.12e-3
_YAW_RAD = np.radians(0.6)
_ENCODER_M = 15e-6

_SLIP_LENGTH_M = 1.6e-3
_SLIP_SETTLES_S = 0.015
_CARRY = 0.06
_TENSION_PER_M = 0.15e3
_SWING_HZ = 0.9


@dataclass(frozen=True)
class Looseness:
    """How freely the material moves.

    Parameters
    ----------
    slip : (2,) m along and across after 1 m of travel, one sigma of the random walk
    swing : m, size of the pendulum motion, one sigma
    """

    slip: tuple[float, float]
    swing: float


FIXTURED = Looseness(slip=(1.5e-3, 0.6e-3), swing=0.04e-3)
"""Training: the material is held at its upper edge."""

HANGING = Looseness(slip=(3.5e-3, 1.2e-3), swing=0.2e-3)
"""Use: the material hangs from the rig; about 0.8 mm of error after a sweep."""


@dataclass(frozen=True)
class Motion:
    """A sweep of n samples.

    Parameters
    ----------
    time : (n,) s from the start
    truth : (n, 2) m, palm relative to the material
    odometry : (n, 2) m, what the arm reports
    direction : (n, 2) unit vectors, which way the fingers slide; kept while the arm speeds up from rest
    yaw : (n,) rad, turn of the hand, which a two-axis scene leaves out
    tension : (n,) share by which the friction is raised while the material is carried along
    """

    time: np.ndarray
    truth: np.ndarray
    odometry: np.ndarray
    direction: np.ndarray
    yaw: np.ndarray
    tension: np.ndarray


def sweep_motion(
    rng: np.random.Generator,
    start: tuple[float, float],
    end: tuple[float, float],
    speed: float,
    rate: float,
    looseness: Looseness,
) -> Motion:
    """Draw one sweep.

    Parameters
    ----------
    start, end : m, where the palm is meant to go, in the material's coordinates
    speed : m/s, nominal
    rate : samples per second
    """
    begin, way = np.asarray(start), np.subtract(end, start)
    length = float(np.linalg.norm(way))
    duration = length / (speed * np.exp(rng.normal(0, 0.03))) + _RAMP_S
    n = max(2, round(duration * rate))
    time = np.arange(n) / rate

    ramp = np.clip(np.minimum(time, duration - time) / _RAMP_S, 0.1, 1)
    profile = ramp * (1 + _SPEED_VARIATION * smooth(rng, n, 1, 0.8 * rate)[:, 0])
    travel = length * np.cumsum(profile) / np.sum(profile)
    wobble = rng.normal(0, _WOBBLE_M, 2) * (0, 1) + _WOBBLE_M * smooth(rng, n, 2, 1.0 * rate)
    arm = begin + travel[:, None] * way / length + wobble

    carried, walk = _stick_slip(rng, travel, rate, looseness)
    swing = looseness.swing * rng.normal(0, 1, 2) * (1, 0.5)
    phase = rng.uniform(0, 2 * np.pi, 2)
    swung = swing * np.sin(2 * np.pi * _SWING_HZ * time[:, None] + phase)
    material = walk + swung + carried[:, None] * way / length

    odometry = arm + _ENCODER_M * rng.standard_normal((n, 2))
    yaw = _YAW_RAD * (0.7 * rng.standard_normal() + 0.7 * smooth(rng, n, 1, 2.0 * rate)[:, 0])
    tension = _TENSION_PER_M * (carried - np.mean(carried))
    slide = speed * way / length + np.gradient(wobble, time, axis=0)
    direction = slide / np.linalg.norm(slide, axis=1, keepdims=True)
    return Motion(time, arm - material + material[0], odometry, direction, yaw, tension)


def _stick_slip(
    rng: np.random.Generator, travel: np.ndarray, rate: float, looseness: Looseness
) -> tuple[np.ndarray, np.ndarray]:
    """How far friction carried the material since it slipped (n,), and what slips left behind (n, 2), m."""
    slips = np.cumsum(rng.exponential(_SLIP_LENGTH_M, size=2 + int(4 * travel[-1] / _SLIP_LENGTH_M)))
    count = np.searchsorted(slips, travel)
    last = np.concatenate([[0.0], slips])[count]
    residues = rng.standard_normal((len(slips) + 1, 2)) * looseness.slip * np.sqrt(_SLIP_LENGTH_M)
    residues[0] = 0
    keep = np.exp(-1 / (rate * _SLIP_SETTLES_S))
    moved = np.column_stack([_CARRY * (travel - last), np.cumsum(residues, axis=0)[count]])
    settled = lfilter([1 - keep], [1.0, -keep], moved, axis=0)
    return settled[:, 0], settled[:, 1:]
