"""Motion of the arm and of the material in a sweep: true palm position and odometry.

The material hangs loosely: friction drags it along until it slips, repeatedly, and it swings (paper,
Sec. II-A). The arm's kinematics do not measure this, so the error of the reported displacement is a random
walk. In a training scan the material is fixtured and moves less.
"""

from dataclasses import dataclass

import numpy as np

from tactile_localizer.sim.noise import recursion, smooth

_RAMP_S = 0.3
"""Time of acceleration and of deceleration, s."""

_SPEED_VARIATION = 0.08
"""Relative standard deviation of the speed within a sweep."""

_PATH_STD_M = 0.12e-3
"""Standard deviation of the arm's deviation from a straight path, m."""

_YAW_STD_RAD = np.radians(0.6)
"""Standard deviation of the hand's rotation, rad."""

_ENCODER_STD_M = 15e-6
"""Standard deviation of the noise of the reported position, m."""

_SLIP_LENGTH_M = 1.6e-3
"""Mean travel between slips, m."""

_SLIP_TIME_S = 0.015
"""Time constant of a slip, s."""

_DRAG_RATIO = 0.06
"""Distance by which the material is dragged along, per distance travelled since the last slip."""

_TENSION_PER_M = 0.15e3
"""Relative increase of the friction per distance that the material is dragged, 1/m."""

_SWING_HZ = 0.9
"""Frequency of the pendulum motion of hanging material, Hz."""


@dataclass(frozen=True)
class Looseness:
    """Mobility of the material.

    Parameters
    ----------
    slip : (2,) standard deviation of the random walk after 1 m of travel, along and across the sweep, m
    swing : standard deviation of the amplitude of the pendulum motion, m
    """

    slip: tuple[float, float]
    swing: float


FIXTURED = Looseness(slip=(1.5e-3, 0.6e-3), swing=0.04e-3)
"""Training: the material is held at its upper edge."""

HANGING = Looseness(slip=(3.5e-3, 1.2e-3), swing=0.2e-3)
"""Localization: the material hangs freely; the error after a sweep is about 0.8 mm."""


@dataclass(frozen=True)
class Motion:
    """Motion in a sweep of n samples.

    Parameters
    ----------
    time : (n,) time since the start, s
    truth : (n, 2) palm position relative to the material, m
    odometry : (n, 2) palm position reported by the arm, m
    direction : (n, 2) unit vectors of the sliding direction
    yaw : (n,) rotation of the hand, rad; not part of a two-axis scene
    tension : (n,) relative change of the friction while the material is dragged along
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
    """Draw the motion of one sweep.

    Parameters
    ----------
    rng : random generator
    start, end : nominal start and end of the palm in the material's coordinates, m
    speed : nominal speed, m/s
    rate : sampling rate, Hz
    looseness : mobility of the material
    """
    begin, path = np.asarray(start), np.subtract(end, start)
    length = float(np.linalg.norm(path))
    duration = length / (speed * np.exp(rng.normal(0, 0.03))) + _RAMP_S
    n = max(2, round(duration * rate))
    time = np.arange(n) / rate

    ramp = np.clip(np.minimum(time, duration - time) / _RAMP_S, 0.1, 1)
    profile = ramp * (1 + _SPEED_VARIATION * smooth(rng, n, 1, 0.8 * rate)[:, 0])
    travel = length * np.cumsum(profile) / np.sum(profile)
    deviation = rng.normal(0, _PATH_STD_M, 2) * (0, 1) + _PATH_STD_M * smooth(rng, n, 2, 1.0 * rate)
    arm = begin + travel[:, None] * path / length + deviation

    dragged, walk = _stick_slip(rng, travel, rate, looseness)
    swing = looseness.swing * rng.normal(0, 1, 2) * (1, 0.5)
    phase = rng.uniform(0, 2 * np.pi, 2)
    pendulum = swing * np.sin(2 * np.pi * _SWING_HZ * time[:, None] + phase)
    material = walk + pendulum + dragged[:, None] * path / length

    odometry = arm + _ENCODER_STD_M * rng.standard_normal((n, 2))
    yaw = _YAW_STD_RAD * (0.7 * rng.standard_normal() + 0.7 * smooth(rng, n, 1, 2.0 * rate)[:, 0])
    tension = _TENSION_PER_M * (dragged - np.mean(dragged))
    slide = speed * path / length + np.gradient(deviation, time, axis=0)
    direction = slide / np.linalg.norm(slide, axis=1, keepdims=True)
    return Motion(time, arm - material + material[0], odometry, direction, yaw, tension)


def _stick_slip(
    rng: np.random.Generator, travel: np.ndarray, rate: float, looseness: Looseness
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (n,) dragged since the last slip, and accumulated displacement (n, 2) after slips, m."""
    slips = np.cumsum(rng.exponential(_SLIP_LENGTH_M, size=2 + int(4 * travel[-1] / _SLIP_LENGTH_M)))
    count = np.searchsorted(slips, travel)
    last = np.concatenate([[0.0], slips])[count]
    residues = rng.standard_normal((len(slips) + 1, 2)) * looseness.slip * np.sqrt(_SLIP_LENGTH_M)
    residues[0] = 0
    keep = np.exp(-1 / (rate * _SLIP_TIME_S))
    moved = np.column_stack([_DRAG_RATIO * (travel - last), np.cumsum(residues, axis=0)[count]])
    settled = recursion((1 - keep) * moved, keep)
    return settled[:, 0], settled[:, 1:]
