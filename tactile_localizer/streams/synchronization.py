"""Palm positions at the stamps of strain vectors, interpolated linearly, and yaw along the shortest arc."""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.scene import Axis
from tactile_localizer.streams.runs import LATE, NANOSECONDS

DEFAULT_MAX_GAP_S = 0.1
"""Longest time between two poses across which positions are still interpolated, s."""


def near_bounds(axes: tuple[Axis, ...], positions: np.ndarray) -> np.ndarray:
    """Positions (d,) or (n, d), m (yaw: rad), with yaw within half a turn of the middle of its bounds."""
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            middle = (axis.lower + axis.upper) / 2
            positions = positions.copy()
            positions.T[column] = middle + wrap_angle(positions.T[column] - middle)
    return positions


def between(
    axes: tuple[Axis, ...], before: np.ndarray, after: np.ndarray, fraction: float | np.ndarray
) -> np.ndarray:
    """Positions (d,) or (n, d), m (yaw: rad), at a ``fraction``, a number or (n, 1), of the way between."""
    step = after - before
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            step.T[column] = wrap_angle(step.T[column])
    return near_bounds(axes, before + fraction * step)


def brackets(
    known_ns: np.ndarray, stamp_ns: np.ndarray, max_gap_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What is known before and after stamps, and where they lie in between.

    Parameters
    ----------
    known_ns : (m,) stamps of what is known, ns, ascending; at least one
    stamp_ns : (n,) stamps, ns
    max_gap_s : longest time between the two known stamps around a stamp, s

    Returns
    -------
    before, after : (n,) int, rows of what is known; equal where a stamp is known
    fraction : (n,) of the way from before to after
    found : (n,) bool; false before the first known stamp, after the last, and in gaps
    """
    after = np.searchsorted(known_ns, stamp_ns)
    inside = after < len(known_ns)
    after = np.minimum(after, len(known_ns) - 1)
    exact = known_ns[after] == stamp_ns
    inside &= exact | (after > 0)
    before = np.where(exact, after, np.maximum(after - 1, 0))
    span = known_ns[after] - known_ns[before]
    fraction = (stamp_ns - known_ns[before]) / np.maximum(span, 1)
    return before, after, fraction, inside & (span <= round(max_gap_s * NANOSECONDS))


def interpolate_poses(
    axes: tuple[Axis, ...],
    pose_ns: np.ndarray,
    poses: np.ndarray,
    stamp_ns: np.ndarray,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate recorded palm poses at the stamps of strain vectors.

    Parameters
    ----------
    axes : the d axes
    pose_ns : (m,) stamps of the poses, ns, ascending
    poses : (m, d) palm positions, m (yaw: rad)
    stamp_ns : (n,) stamps of the strain vectors, ns
    max_gap_s : longest time between the two poses around a stamp, s

    Returns
    -------
    positions : (n, d) ndarray; NaN where there is none
    found : (n,) bool; false before the first pose, after the last, and in gaps
    """
    positions = np.full((len(stamp_ns), len(axes)), math.nan)
    if not len(pose_ns):
        return positions, np.zeros(len(stamp_ns), dtype=bool)
    before, after, fraction, found = brackets(pose_ns, stamp_ns, max_gap_s)
    positions[found] = between(axes, poses[before], poses[after], fraction[:, None])[found]
    return positions, found


def interpolate_pose(
    axes: tuple[Axis, ...],
    pose_ns: Sequence[int],
    poses: Sequence[np.ndarray],
    stamp_ns: int,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> np.ndarray | None:
    """Interpolate recorded palm poses at one stamp, faster than :func:`interpolate_poses` does.

    Parameters
    ----------
    axes : the d axes
    pose_ns : m stamps of the poses, ns, ascending
    poses : their positions (d,), m (yaw: rad)
    stamp_ns : stamp of the strain vector, ns
    max_gap_s : longest time between the two poses around the stamp, s

    Returns
    -------
    (d,) ndarray; ``None`` before the first pose, after the last, and in gaps
    """
    after = bisect_left(pose_ns, stamp_ns)
    if after == len(pose_ns):
        return None
    before = after if pose_ns[after] == stamp_ns else after - 1
    if before < 0 or (span_ns := pose_ns[after] - pose_ns[before]) > round(max_gap_s * NANOSECONDS):
        return None
    return between(axes, poses[before], poses[after], (stamp_ns - pose_ns[before]) / max(span_ns, 1))


def interpolate_runs(
    axes: tuple[Axis, ...],
    run: np.ndarray,
    stamp_ns: np.ndarray,
    poses_of: Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray]],
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> np.ndarray:
    """Interpolate palm poses at the stamps of strain vectors of several runs, each in its own; see ``Runs``.

    Parameters
    ----------
    axes : the d axes
    run : (n,) int, runs of the strain vectors, or :data:`~.runs.LATE`
    stamp_ns : (n,) their stamps, ns
    poses_of : given a run and the stamps in it: stamps (m,), ns, ascending, and finite positions (m, d), m
        (yaw: rad), of the poses around them
    max_gap_s : longest time between the two poses around a stamp, s

    Returns
    -------
    (n, d) ndarray; NaN where there is none
    """
    positions = np.full((len(stamp_ns), len(axes)), math.nan)
    for number in {*run.tolist()} - {LATE}:
        rows = run == number
        poses = poses_of(number, stamp_ns[rows])
        positions[rows], _ = interpolate_poses(axes, *poses, stamp_ns[rows], max_gap_s)
    return positions
