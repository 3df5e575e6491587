"""Palm positions at the stamps of strain vectors, in recordings and live.

Positions are interpolated linearly and yaw along the shortest arc. Stamps alone decide what is old, late or
missing; nothing reads a clock, so a recording gives the same result at any playback rate.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis

T = TypeVar("T")

NANOSECONDS = 1_000_000_000

DEFAULT_MAX_GAP_S = 0.1
"""Longest time between two poses across which positions are still interpolated, s."""

DEFAULT_PATIENCE_S = 1.0
"""Longest time, by stamps, that a strain vector waits for the pose that follows it, s."""


def near_bounds(axes: tuple[Axis, ...], positions: np.ndarray) -> np.ndarray:
    """Positions (..., d), m (yaw: rad), with yaw within half a turn of the middle of its bounds."""
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            middle = (axis.lower + axis.upper) / 2
            positions = positions.copy()
            positions[..., column] = middle + wrap_angle(positions[..., column] - middle)
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
    step = poses[after] - poses[before]
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            step[:, column] = wrap_angle(step[:, column])
    positions[found] = near_bounds(axes, poses[before] + fraction * step)[found]
    return positions, found


@dataclass(frozen=True)
class Pair(Generic[T]):
    """A strain vector with the palm position at its stamp.

    Parameters
    ----------
    stamp_ns : of the strain vector, ns
    position : (d,) palm position, m (yaw: rad); ``None`` when no pose was near enough in time
    measurement : the strain vector, in the form given to :meth:`Pairing.add_strain`
    """

    stamp_ns: int
    position: np.ndarray | None
    measurement: T


class Pairing(Generic[T]):
    """Pairs strain vectors with palm positions by their stamps, as they arrive.

    A strain vector waits for the pose that follows it. Whichever topic is late, the pairs are those that
    :func:`interpolate_poses` finds in a recording of both. A stamp that is not later than the newest of its
    topic is late, unless it is so much earlier that time itself has jumped back (a looping bag).

    Parameters
    ----------
    axes : the d axes
    max_gap_s : longest time between the two poses around a strain vector, s
    patience_s : a strain vector that is older than the newest by more than this waits no longer, s

    Attributes
    ----------
    late : number of poses and strain vectors dropped because a later one had already arrived
    resets : number of backward jumps of the stamps, each of which clears everything
    forward_jumps : number of strain stamps more than ``patience_s`` after the last: silence, or a clock set
    """

    def __init__(
        self,
        axes: tuple[Axis, ...],
        *,
        max_gap_s: float = DEFAULT_MAX_GAP_S,
        patience_s: float = DEFAULT_PATIENCE_S,
    ) -> None:
        self.late = 0
        self.resets = 0
        self.forward_jumps = 0
        self._axes = axes
        self._max_gap_s = max_gap_s
        self._patience_ns = round(patience_s * NANOSECONDS)
        # Poses are kept for as long as a strain vector that needs them may wait.
        self._length_ns = 2 * self._patience_ns + round(max_gap_s * NANOSECONDS)
        self._pose_ns: list[int] = []
        self._poses: list[np.ndarray] = []
        self._waiting: deque[tuple[int, T]] = deque()
        self._newest_strain_ns: int | None = None

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest strain vector, ns; ``None`` before the first."""
        return self._newest_strain_ns

    @property
    def newest_pose_ns(self) -> int | None:
        """Stamp of the newest pose, ns; ``None`` before the first."""
        return self._pose_ns[-1] if self._pose_ns else None

    @property
    def newest_input_ns(self) -> int:
        """Stamp of the newest strain vector or pose, ns; 0 before the first."""
        return max(self._newest_strain_ns or 0, self.newest_pose_ns or 0)

    @property
    def waiting_ns(self) -> int | None:
        """Stamp of the oldest strain vector that waits for a pose, ns; ``None`` when none waits."""
        return self._waiting[0][0] if self._waiting else None

    @property
    def waiting(self) -> int:
        """Number of strain vectors that wait for a pose."""
        return len(self._waiting)

    def add_pose(self, stamp_ns: int, position: np.ndarray) -> list[Pair[T]]:
        """Add a palm position (d,), m (yaw: rad); returns the pairs that are now complete, by stamp.

        Raises
        ------
        MeasurementError
            The position is not finite or not of the scene's axes.
        """
        if np.shape(position) != (len(self._axes),) or not np.all(np.isfinite(position)):
            names = ", ".join(axis.name for axis in self._axes)
            raise MeasurementError(f"palm position: expected finite {names}, got {position}")
        done = self._arrived(stamp_ns, self.newest_pose_ns)
        if done is None:
            return []
        self._pose_ns.append(stamp_ns)
        self._poses.append(np.asarray(position, dtype=np.float64))
        # Deleting only once half of the poses are old makes the cost per pose constant.
        if 2 * (stamp_ns - self._pose_ns[0]) > 3 * self._length_ns:
            old = bisect_left(self._pose_ns, stamp_ns - self._length_ns)
            del self._pose_ns[:old], self._poses[:old]
        return done + self._complete()

    def add_strain(self, stamp_ns: int, measurement: T) -> list[Pair[T]]:
        """Add a strain vector; returns the pairs that are now complete, by stamp."""
        newest = self._newest_strain_ns
        done = self._arrived(stamp_ns, newest)
        if done is None:
            return []
        self.forward_jumps += newest is not None and stamp_ns - newest > self._patience_ns
        self._newest_strain_ns = stamp_ns
        self._waiting.append((stamp_ns, measurement))
        return done + self._complete()

    def finish(self) -> list[Pair[T]]:
        """End of the stream: returns the strain vectors that are still waiting, without positions."""
        unpaired = [Pair(stamp_ns, None, measurement) for stamp_ns, measurement in self._waiting]
        self._waiting.clear()
        return unpaired

    def _complete(self) -> list[Pair[T]]:
        pairs = []
        newest_pose, newest_strain = self.newest_pose_ns, self._newest_strain_ns
        while self._waiting and newest_strain is not None:
            stamp_ns, measurement = self._waiting[0]
            must_wait = newest_pose is None or stamp_ns > newest_pose
            if must_wait and newest_strain - stamp_ns <= self._patience_ns:
                break
            self._waiting.popleft()
            pairs.append(Pair(stamp_ns, self._position(stamp_ns), measurement))
        return pairs

    def _position(self, stamp_ns: int) -> np.ndarray | None:
        after = bisect_left(self._pose_ns, stamp_ns)
        around = slice(max(after - 1, 0), after + 1)
        pose_ns, poses = np.array(self._pose_ns[around]), np.array(self._poses[around])
        positions, found = interpolate_poses(
            self._axes, pose_ns, poses, np.array([stamp_ns]), self._max_gap_s
        )
        return positions[0] if found[0] else None

    def _arrived(self, stamp_ns: int, newest_ns: int | None) -> list[Pair[T]] | None:
        """Pairs that end where time jumps back; ``None``: the stamp is late by the newest of its topic."""
        if newest_ns is None or stamp_ns > newest_ns:
            return []
        if newest_ns - stamp_ns <= self._length_ns:
            self.late += 1
            return None
        self.resets += 1
        self._newest_strain_ns = None
        self._pose_ns.clear()
        self._poses.clear()
        return self.finish()
