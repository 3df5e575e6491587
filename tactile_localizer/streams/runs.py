"""Runs of stamps, between which time jumps back: the one rule for stamps, live and in recordings."""

from typing import Any

import numpy as np

from tactile_localizer.errors import MeasurementError

NANOSECONDS = 1_000_000_000

LATE = -1
"""In place of the number of a run: dropped, because a later message had already arrived."""

STRAIN, POSES = 0, 1

_JUMP_NS = NANOSECONDS // 2
"""ns by which a stamp is earlier than the newest of its topic where time has jumped back (judgement).
Messages that overtake each other do so by less."""
_FOLLOWING_NS = NANOSECONDS
"""ns of stamps after a jump of one topic within which the other one jumps too, if it does (judgement)."""


def to_ns(stamp: Any) -> int:
    """Nanoseconds of a time stamp of ROS, of rclpy or rosbags; 0 means that the clock has not started."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def stamp_of(message: Any) -> int:
    """Stamp in the header of a message, ns.

    Raises
    ------
    MeasurementError
        It is 0.
    """
    if not (stamp_ns := to_ns(message.header.stamp)):
        raise MeasurementError("expected a stamp, found 0: the clock of the sender has not started")
    return stamp_ns


class Runs:
    """Runs of strain and poses: time jumps back where a bag loops, a clock is set, or another run begins.

    A stamp that is not later than the newest of its topic is late, unless it is earlier by more than half a
    second: then time itself has jumped back, and another run of the topic begins. Each run of the strain is a
    sweep of its own. Strain is paired with the poses of the run of the same number, whichever topic jumps
    first; a topic that does not jump within a second of the other one's stamps is taken along.

    :class:`~.session.Session` applies it to what arrives, live or recorded, and :func:`runs_of` to the rows
    of a file.

    Attributes
    ----------
    newest_ns : newest stamps of :data:`STRAIN` and :data:`POSES`, ns; ``None`` before the first
    number : their runs, from 0
    jumps : numbers of their backward jumps
    late : numbers of their messages that were late
    """

    def __init__(self) -> None:
        self.newest_ns: list[int | None] = [None, None]
        self.number, self.jumps, self.late = [0, 0], [0, 0], [0, 0]
        self._begin_ns = [0, 0]

    def add(self, topic: int, stamp_ns: int) -> int:
        """The run of the next message to arrive, or :data:`LATE`.

        Parameters
        ----------
        topic : :data:`STRAIN` or :data:`POSES`
        stamp_ns : its stamp, ns
        """
        newest_ns, other = self.newest_ns[topic], 1 - topic
        if newest_ns is not None and stamp_ns <= newest_ns:
            if newest_ns - stamp_ns <= _JUMP_NS:
                self.late[topic] += 1
                return LATE
            self.jumps[topic] += 1
            self.number[topic] += 1
            self._begin_ns[topic] = stamp_ns
            self.number[other] = max(self.number[other], self.number[topic] - 1)
        elif self.number[topic] > self.number[other] and stamp_ns - self._begin_ns[topic] > _FOLLOWING_NS:
            self.number[other] = self.number[topic]
        self.newest_ns[topic] = stamp_ns
        return self.number[topic]


def runs_of(stamp_ns: np.ndarray) -> np.ndarray:
    """Number of the run of each message of one topic, (n,) int from 0; :data:`LATE` where it is late.

    Parameters
    ----------
    stamp_ns : (n,) stamps in the order of arrival or of the rows of a file, ns
    """
    if (np.diff(stamp_ns) > 0).all():
        return np.zeros(len(stamp_ns), dtype=np.intp)
    runs = Runs()
    return np.array([runs.add(STRAIN, each) for each in stamp_ns.tolist()], dtype=np.intp)


def rows_at(stamp_ns: np.ndarray, at_ns: np.ndarray) -> np.ndarray:
    """Rows (n,) of rising stamps (m,), ns, that are the newest at stamps (n,); before all, the first."""
    return np.searchsorted(stamp_ns, at_ns, side="right").clip(1) - 1
