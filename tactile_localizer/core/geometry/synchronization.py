"""Pairing of live strain vectors with the palm position at their stamps.

A strain vector waits for the pose that follows it. Whichever topic is late, the pairs are those that
:func:`~tactile_localizer.core.geometry.pose_buffer.interpolate_poses` finds in a recording of both.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from tactile_localizer.core.geometry.pose_buffer import DEFAULT_MAX_GAP_S, NANOSECONDS, PoseBuffer
from tactile_localizer.scene import Axis

T = TypeVar("T")

DEFAULT_PATIENCE_S = 1.0
"""Longest time, by stamps, that a strain vector waits for the pose that follows it, s."""


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
    """Pairs strain vectors with palm positions by their stamps.

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
        self._patience_ns = round(patience_s * NANOSECONDS)
        # Poses are kept for as long as a strain vector that needs them may wait.
        self._length_s = 2 * patience_s + max_gap_s
        self._poses = PoseBuffer(axes, max_gap_s=max_gap_s, length_s=self._length_s)
        self._waiting: deque[tuple[int, T]] = deque()
        self._newest_strain_ns: int | None = None

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest strain vector, ns; ``None`` before the first."""
        return self._newest_strain_ns

    @property
    def newest_pose_ns(self) -> int | None:
        """Stamp of the newest pose, ns; ``None`` before the first."""
        return self._poses.newest_ns

    @property
    def newest_input_ns(self) -> int:
        """Stamp of the newest strain vector or pose, ns; 0 before the first."""
        return max(self._newest_strain_ns or 0, self._poses.newest_ns or 0)

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
        newest = self._poses.newest_ns
        done: list[Pair[T]] = []
        if not self._poses.add(stamp_ns, position):
            self.late += 1
        elif newest is not None and stamp_ns < newest:
            done = self._reset()
        return done + self._complete()

    def add_strain(self, stamp_ns: int, measurement: T) -> list[Pair[T]]:
        """Add a strain vector; returns the pairs that are now complete, by stamp."""
        newest = self._newest_strain_ns
        done: list[Pair[T]] = []
        if newest is not None and stamp_ns <= newest:
            if newest - stamp_ns <= self._length_s * NANOSECONDS:
                self.late += 1
                return []
            self._poses.clear()
            done = self._reset()
        elif newest is not None:
            self.forward_jumps += stamp_ns - newest > self._patience_ns
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
        newest_pose, newest_strain = self._poses.newest_ns, self._newest_strain_ns
        while self._waiting and newest_strain is not None:
            stamp_ns, measurement = self._waiting[0]
            must_wait = newest_pose is None or stamp_ns > newest_pose
            if must_wait and newest_strain - stamp_ns <= self._patience_ns:
                break
            self._waiting.popleft()
            pairs.append(Pair(stamp_ns, self._poses.at(stamp_ns), measurement))
        return pairs

    def _reset(self) -> list[Pair[T]]:
        self.resets += 1
        self._newest_strain_ns = None
        return self.finish()
