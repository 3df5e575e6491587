"""Palm poses, buffered and interpolated at the stamps of strain vectors.

Positions are interpolated linearly and yaw along the shortest arc. Stamps alone decide what is old, late or
missing; nothing reads a clock, so a recording gives the same result at any playback rate.
"""

from __future__ import annotations

import math
from bisect import bisect_left

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis

NANOSECONDS = 1_000_000_000

DEFAULT_MAX_GAP_S = 0.1
"""Longest time between two poses across which positions are still interpolated, s."""


def near_bounds(axes: tuple[Axis, ...], positions: np.ndarray) -> np.ndarray:
    """Positions (n, d), m (yaw: rad), with yaw within half a turn of the middle of its bounds."""
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            middle = (axis.lower + axis.upper) / 2
            positions = positions.copy()
            positions[:, column] = middle + wrap_angle(positions[:, column] - middle)
    return positions


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
    fraction = ((stamp_ns - pose_ns[before]) / np.maximum(span, 1))[:, None]
    positions[found] = _between(axes, poses[before], poses[after], fraction)[found]
    return positions, found


def _between(
    axes: tuple[Axis, ...], first: np.ndarray, second: np.ndarray, fraction: float | np.ndarray
) -> np.ndarray:
    """Positions (n, d) at a ``fraction`` of the way from ``first`` to ``second``, (n, d) each."""
    step = second - first
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            step[:, column] = wrap_angle(step[:, column])
    return near_bounds(axes, first + fraction * step)


class PoseBuffer:
    """The palm poses of the last seconds.

    A pose whose stamp is not later than the newest is dropped as late. A stamp that is earlier by more than
    ``length_s`` means that time itself has jumped back (a looping bag): the buffer is cleared.

    Parameters
    ----------
    axes : the d axes
    max_gap_s : longest time between the two poses around a stamp, s
    length_s : how long poses are kept, s
    """

    def __init__(
        self, axes: tuple[Axis, ...], *, max_gap_s: float = DEFAULT_MAX_GAP_S, length_s: float = 5.0
    ) -> None:
        self.axes = axes
        self._max_gap_ns = round(max_gap_s * NANOSECONDS)
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
        """Add the palm position (d,), m (yaw: rad), at a stamp; returns false if it was dropped as late.

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
        # Deleting only once the buffer is half full of old poses makes the cost per pose constant.
        if 2 * (stamp_ns - self._stamps[0]) > 3 * self._length_ns:
            old = bisect_left(self._stamps, stamp_ns - self._length_ns)
            del self._stamps[:old], self._poses[:old]
        return True

    def at(self, stamp_ns: int) -> np.ndarray | None:
        """The palm position (d,) at a stamp, m (yaw: rad), as by :func:`interpolate_poses`.

        ``None`` if the stamp is older than all poses, newer than all (see :attr:`newest_ns`), or in a gap.
        """
        after = bisect_left(self._stamps, stamp_ns)
        if after == len(self._stamps):
            return None
        before = after if self._stamps[after] == stamp_ns else after - 1
        if before < 0 or self._stamps[after] - self._stamps[before] > self._max_gap_ns:
            return None
        span = max(self._stamps[after] - self._stamps[before], 1)
        fraction = (stamp_ns - self._stamps[before]) / span
        return _between(self.axes, self._poses[before][None], self._poses[after][None], fraction)[0]

    def clear(self) -> None:
        """Remove all poses."""
        self._stamps.clear()
        self._poses.clear()
