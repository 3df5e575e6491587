"""Measures of the palm's motion: positions of two sources, positions that are held, and none that change.

The thresholds are judgement.
"""

from collections.abc import Iterator

import numpy as np

from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.scene import Axis
from tactile_localizer.streams.arrivals import Measure, Seen
from tactile_localizer.streams.runs import NANOSECONDS

_STILL = 1e-5
"""Range of positions that do not change, m, less than a load cell resolves."""
_MIN_COUNT = 5
"""Number of positions, jumps or steps below which nothing is reported."""
_OFF, _ACCELERATION = 0.002, 10.0
"""Distance from the line through its neighbours, m, and acceleration of a hand, m/s^2, beyond which a
position jumps."""
_HELD_S, _STEP = (0.025, 0.3), 0.0005
"""Shortest and longest time for which positions are held, s, and length of the steps, m."""
_BETWEEN = 3
"""Number of positions from one that is held to the next where it is a step, not a motion."""

_Motion = tuple[np.ndarray, np.ndarray, float, str]
"""Stamps (n,), ns, and places (n, 1 or 2), m, which are shown in a unit after times a factor."""


def stillness(seen: Seen) -> Measure:
    """Time over which the position does not change, s, of the last run."""
    *_, (stamp_ns, position) = seen.runs()
    motion = next(_motions(seen.axes, stamp_ns, position), None)
    if motion is not None and _is_still(motion[1]):
        yield float(stamp_ns[-1] - stamp_ns[0]) / NANOSECONDS, {}


def jumping(seen: Seen) -> Measure:
    """Fraction of the positions that are off the line through their neighbours, which no hand is."""
    for stamp_ns, place, factor, unit in _all_motions(seen):
        step, period_s = np.diff(place, axis=0), np.diff(stamp_ns) / NANOSECONDS
        before, after = period_s[:-1], period_s[1:]
        across = np.linalg.norm(step[:-1] + step[1:], axis=1)
        off = np.linalg.norm(after[:, None] * step[:-1] - before[:, None] * step[1:], axis=1)
        off /= before + after
        jumps = off > np.maximum(_OFF + _ACCELERATION / 2 * before * after, across)
        if np.count_nonzero(jumps) >= _MIN_COUNT:
            size, ms = factor * np.quantile(off[jumps], 0.9), 1e3 * before[jumps].min()
            yield np.count_nonzero(jumps) / len(place), {"size": size, "unit": unit, "ms": ms}


def holding(seen: Seen) -> Measure:
    """Fraction of the time in motion for which the position is held before it steps."""
    for stamp_ns, place, factor, unit in _all_motions(seen):
        begin = np.flatnonzero(np.append(True, np.diff(place, axis=0).any(axis=1)))
        lasting_s = (stamp_ns[np.append(begin[1:], len(place)) - 1] - stamp_ns[begin]) / NANOSECONDS
        held = np.flatnonzero((lasting_s >= _HELD_S[0]) & (lasting_s <= _HELD_S[1]))
        size = np.linalg.norm(np.diff(place[begin[held]], axis=0), axis=1)
        steps = (np.diff(held) <= _BETWEEN) & (size >= _STEP)
        moving_s = (stamp_ns[-1] - stamp_ns[0]) / NANOSECONDS - lasting_s[lasting_s > _HELD_S[1]].sum()
        if np.count_nonzero(steps) >= _MIN_COUNT:
            every_ms = np.median(np.diff(stamp_ns[begin[held]])[steps]) / NANOSECONDS * 1e3
            words = {"ms": every_ms, "size": factor * np.median(size[steps]), "unit": unit}
            yield float(lasting_s[held].sum() / moving_s), words


def _is_still(place: np.ndarray) -> bool:
    return bool((np.ptp(place, axis=0) < _STILL).all())


def _all_motions(seen: Seen) -> Iterator[_Motion]:
    """Motions in each run, but of a palm at rest."""
    for run in seen.runs():
        yield from (motion for motion in _motions(seen.axes, *run) if not _is_still(motion[1]))


def _motions(axes: tuple[Axis, ...], stamp_ns: np.ndarray, position: np.ndarray) -> Iterator[_Motion]:
    """The motion in x and y, and that of a fingertip where the palm turns."""
    turns = np.array([axis.name == "yaw" for axis in axes])
    if len(position) >= _MIN_COUNT and not turns.all():
        yield stamp_ns, position[:, ~turns], 1e3, " mm"
    if len(position) >= _MIN_COUNT and turns.any():
        yield stamp_ns, YAW_LEVER * np.unwrap(position[:, turns], axis=0), 1.0 / YAW_LEVER, " rad"
