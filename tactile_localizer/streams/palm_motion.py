"""Plausibility of the palm's motion: positions of two sources, positions that are held, and none that change.

Each displaces a map without a trace in the strain. The thresholds are judgement.
"""

import numpy as np

from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.scene import Axis
from tactile_localizer.streams.runs import NANOSECONDS

_STILL, _STILL_S = 1e-5, 0.5
"""Range of positions that do not change, m, less than a load cell resolves; shortest time, s."""
_MIN_COUNT = 5
"""Number of positions, jumps or steps below which nothing is reported."""
_OFF, _ACCELERATION = 0.002, 10.0
"""Distance from the line through its neighbours, m, and acceleration of a hand, m/s^2, beyond which a
position jumps."""
_JUMPING = 0.05
"""Fraction of the positions that jump where there are two sources."""
_HELD_S, _STEP = (0.025, 0.3), 0.0005
"""Shortest and longest time for which positions are held, s, and length of the steps, m."""
_BETWEEN = 3
"""Number of positions from one that is held to the next where it is a step, not a motion."""
_HELD = 0.5
"""Fraction of the time in motion for which positions are held."""


def describe_motion(
    axes: tuple[Axis, ...], stamp_ns: np.ndarray, position: np.ndarray, moves: bool = True
) -> str:
    """What is implausible about palm positions, in one line; empty if nothing is.

    Positions that jump there and back are from two sources, such as two publishers of one topic. Positions
    that are held and then step are from a source that is slower than their stamps.

    Parameters
    ----------
    axes : the d axes; the motion is that in x and y, and that of a fingertip where the palm turns
    stamp_ns : (n,) rising stamps, ns, of measured poses rather than of strain between them
    position : (n, d) palm positions, m (yaw: rad), finite
    moves : whether it is implausible that the palm is at rest all the time
    """
    if len(position) < _MIN_COUNT:
        return ""
    turns = np.array([axis.name == "yaw" for axis in axes])
    motions = (
        (position[:, ~turns], 1e3, " mm"),
        (YAW_LEVER * np.unwrap(position[:, turns], axis=0), 1.0 / YAW_LEVER, " rad"),
    )
    there = [motion for motion in motions if motion[0].shape[1]]
    if (np.ptp(there[0][0], axis=0) < _STILL).all():
        lasting_s = (stamp_ns[-1] - stamp_ns[0]) / NANOSECONDS
        return (
            f"the position does not change over {lasting_s:.1f} s" if moves and lasting_s >= _STILL_S else ""
        )
    return next(filter(None, (_implausible(stamp_ns, *motion) for motion in there)), "")


def _implausible(stamp_ns: np.ndarray, place: np.ndarray, factor: float, unit: str) -> str:
    """What is implausible about places (n, 1 or 2), m, which are shown in ``unit`` after times ``factor``."""
    step, period_s = np.diff(place, axis=0), np.diff(stamp_ns) / NANOSECONDS
    before, after = period_s[:-1], period_s[1:]
    across = np.linalg.norm(step[:-1] + step[1:], axis=1)
    off = np.linalg.norm(after[:, None] * step[:-1] - before[:, None] * step[1:], axis=1) / (before + after)
    jumps = off > np.maximum(_OFF + _ACCELERATION / 2 * before * after, across)
    if np.count_nonzero(jumps) >= max(_MIN_COUNT, _JUMPING * len(place)):
        size, ms = factor * np.quantile(off[jumps], 0.9), 1e3 * before[jumps].min()
        return f"the position jumps by {size:.2g}{unit} within {ms:.2g} ms and back: two sources, or noise"
    begin = np.flatnonzero(np.append(True, step.any(axis=1)))
    lasting_s = (stamp_ns[np.append(begin[1:], len(place)) - 1] - stamp_ns[begin]) / NANOSECONDS
    held = np.flatnonzero((lasting_s >= _HELD_S[0]) & (lasting_s <= _HELD_S[1]))
    size = np.linalg.norm(np.diff(place[begin[held]], axis=0), axis=1)
    steps = (np.diff(held) <= _BETWEEN) & (size >= _STEP)
    moving_s = period_s.sum() - lasting_s[lasting_s > _HELD_S[1]].sum()
    if np.count_nonzero(steps) >= _MIN_COUNT and lasting_s[held].sum() > _HELD * moving_s:
        every_ms = np.median(np.diff(stamp_ns[begin[held]])[steps]) / NANOSECONDS * 1e3
        size_mm = factor * np.median(size[steps])
        return f"the position is held for {every_ms:.0f} ms, then steps by {size_mm:.2g}{unit}: a slow source"
    return ""
