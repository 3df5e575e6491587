"""Palm poses, buffered and interpolated at the stamps of strain vectors.

Positions are interpolated linearly and yaw along the shortest arc. Nothing here reads a clock: what
is old, late or missing follows from stamps alone, so a recording played at any rate gives the same result.
"""

from __future__ import annotations

import math
from bisect import bisect_left

import numpy as np

from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis

NANOSECONDS = 1_000_000_000

DEFAULT_MAX_GAP_S = 0.1
"""Longest time between two poses across which positions are still interpolated, s."""


def near_bounds(axes: tuple[Axis, ...], positions: np.ndarray) -> np.ndarray:
    """The same positions with yaw within half a turn of the middle of its bounds.

    Parameters
    ----------
    axes : the d axes
    positions : (n, d) palm positions, m (yaw: rad)

    Returns
    -------
    (n, d) ndarray
        ``positions`` itself where no axis is a yaw.
    """
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            middle = (axis.lower + axis.upper) / 2
            positions = positions.copy()
            positions[:, column] = middle + _shortest_arc(positions[:, column] - middle)
    return positions


def interpolate_poses(
    axes: tuple[Axis, ...],
    pose_ns: np.ndarray,
    poses: np.ndarray,
    stamp_ns: np.ndarray,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> tuple[np.ndarray, np.ndarray]:
    """Palm positions at the stamps of strain vectors, from poses recorded at other times.

    Parameters
    ----------
    axes : the d axes
    pose_ns : (m,) stamps of the poses, ns, ascending
    poses : (m, d) palm positions, m (yaw: rad)
    stamp_ns : (n,) stamps at which positions are wanted, ns
    max_gap_s : longest time between the two poses around a stamp, s

    Returns
    -------
    positions : (n, d) ndarray; NaN where there is none
    found : (n,) bool; false before the first pose, after the last, and in gaps
    """
    positions = np.full((len(stamp_ns), len(axes)), math.nan)
    found = np.zeros(len(stamp_ns), dtype=bool)
    if not len(pose_ns):
        return positions, found
    after = np.searchsorted(pose_ns, stamp_ns)
    inside = after < len(pose_ns)
    after = np.minimum(after, len(pose_ns) - 1)
    exact = pose_ns[after] == stamp_ns
    inside &= exact | (after > 0)
    before = np.where(exact, after, np.maximum(after - 1, 0))
    span = pose_ns[after] - pose_ns[before]
    found = inside & (span <= round(max_gap_s * NANOSECONDS))
    share = (stamp_ns - pose_ns[before]) / np.maximum(span, 1)
    step = poses[after] - poses[before]
    yaw = [axis.name == "yaw" for axis in axes]
    step[:, yaw] = _shortest_arc(step[:, yaw])
    moved = poses[before] + share[:, None] * step
    positions[found] = near_bounds(axes, moved[found])
    return positions, found


class PoseBuffer:
    """The palm poses of the last seconds.

    Parameters
    ----------
    axes : the d axes
    max_gap_s : longest time between the two poses around a stamp, s
    length_s : how long poses are kept, s

    Notes
    -----
    A pose whose stamp is not later than the newest is dropped as late. One that is earlier by more
    than ``length_s`` means that time itself was set back (a looping bag): the buffer starts anew.
    """

    def __init__(
        self, axes: tuple[Axis, ...], *, max_gap_s: float = DEFAULT_MAX_GAP_S, length_s: float = 5.0
    ) -> None:
        self.axes = axes
        self._max_gap_ns = round(max_gap_s * NANOSECONDS)
        self._yaw = [column for column, axis in enumerate(axes) if axis.name == "yaw"]
        self._length_ns = round(length_s * NANOSECONDS)
        self._stamps: list[int] = []
        self._poses: list[np.ndarray] = []

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose, ns; ``None`` before the first."""
        return self._stamps[-1] if self._stamps else None

    def add(self, stamp_ns: int, position: np.ndarray) -> bool:
        """Add a pose.

        Parameters
        ----------
        stamp_ns : its stamp, ns
        position : (d,) palm position, m (yaw: rad)

        Returns
        -------
        bool
            False when the pose came late and was dropped.

        Raises
        ------
        MeasurementError
            The position is not finite or not of the scene's axes.
        """
        if np.shape(position) != (len(self.axes),) or not np.all(np.isfinite(position)):
            names = ", ".join(axis.name for axis in self.axes)
            raise MeasurementError(f"palm position: expected finite {names}, got {position}")
        if self._stamps and stamp_ns <= self._stamps[-1]:
            if self._stamps[-1] - stamp_ns <= self._length_ns:
                return False
            self.clear()
        self._stamps.append(stamp_ns)
        self._poses.append(np.asarray(position, dtype=np.float64))
        # Half as much again is kept before the old ones go, so that going costs nothing on average.
        if 2 * (stamp_ns - self._stamps[0]) > 3 * self._length_ns:
            old = bisect_left(self._stamps, stamp_ns - self._length_ns)
            del self._stamps[:old], self._poses[:old]
        return True

    def at(self, stamp_ns: int) -> np.ndarray | None:
        """The palm position (d,) at a stamp, m (yaw: rad).

        Returns
        -------
        ndarray or None
            ``None`` when the stamp is older than all poses, newer than all, or in a gap. A caller
            that would wait for a newer pose compares with :attr:`newest_ns` first.
        """
        after = bisect_left(self._stamps, stamp_ns)
        if after == len(self._stamps):
            return None
        if self._stamps[after] == stamp_ns:
            return near_bounds(self.axes, self._poses[after][None])[0]
        if after == 0 or self._stamps[after] - self._stamps[after - 1] > self._max_gap_ns:
            return None
        # As interpolate_poses, without its cost for arrays: this runs for every strain vector.
        span = self._stamps[after] - self._stamps[after - 1]
        share = (stamp_ns - self._stamps[after - 1]) / span
        step = self._poses[after] - self._poses[after - 1]
        if self._yaw:
            step[self._yaw] = _shortest_arc(step[self._yaw])
        return near_bounds(self.axes, (self._poses[after - 1] + share * step)[None])[0]

    def clear(self) -> None:
        """Forget all poses."""
        self._stamps.clear()
        self._poses.clear()


def _shortest_arc(angle: np.ndarray) -> np.ndarray:
    """The same angles within half a turn of zero, rad."""
    return angle - math.tau * np.round(angle / math.tau)
