"""Cut of the frames on a bus into cycles: which frame is the first of a cycle.

Every load cell sends once per cycle, in an order that lasts. So a cycle ends when one of them sends again, at
any pace, and however late the bus delivers. Time decides only which frame comes first, and of which cycle a
frame is before which others were lost: the first frame is the one behind the largest gap, which is followed
as the phases of the load cells drift.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS = 500_000, 1_000_000_000
"""Range of estimated periods, ns: 2 kHz to 1 Hz."""

PAUSE_NS = 2 * LONGEST_PERIOD_NS
"""Silence of the whole bus from which the hand may have been off: nothing is lost, counters begin anew."""

_INTERVALS = 64
"""Number of intervals from which the period of a message is estimated."""

_EACH = 16
"""Number of samples after which that is done again."""

_SLOW = 1.2
"""Number of cycles per sample from which a load cell is slower than the fastest one."""

_LARGER = 1.5
"""Ratio from which a gap within cycles is larger than that before them."""

_CONFIRMATIONS = 4
"""Cycles in a row with a larger gap after which they begin behind it; 2 among the first cycles, unless the
load cells send irregularly: on a busy machine, gaps within their bursts are then soon larger twice."""


@dataclass(slots=True, eq=False)
class Pace:
    """Times of the frames of one message.

    Attributes
    ----------
    last_ns : stamp of the newest frame, ns; 0 before the first
    cycle : number of its cycle
    lag_ns : time from the begin of that cycle, ns
    received : number of frames on the bus until it
    period_ns : usual time between two samples, ns; 0: unknown
    cycles_per_sample : 1.0 unless the load cell is slower than the fastest one
    """

    last_ns: int = 0
    cycle: int = 0
    lag_ns: int = 0
    received: int = 0
    period_ns: float = 0.0
    cycles_per_sample: float = 1.0
    _intervals: deque[float] = field(default_factory=lambda: deque(maxlen=_INTERVALS))
    _cycles: deque[float] = field(default_factory=lambda: deque(maxlen=_INTERVALS))
    measured: int = 0

    def note(self, elapsed_ns: int, cycles: int, samples: int) -> bool:
        """Note the time and the cycles since the frame before; returns whether a new estimate is due."""
        self._intervals.append(elapsed_ns / samples)
        self._cycles.append(cycles / samples)
        self.measured += 1
        return self.measured <= _EACH or not self.measured % _EACH

    def estimate(self) -> None:
        """Estimate the period."""
        self.period_ns = max(_usual(self._intervals), SHORTEST_PERIOD_NS)

    def compare(self, fastest_ns: float) -> None:
        """Estimate the number of cycles per sample.

        Counted, because that does not depend on the pace; a load cell that loses samples is not slow.
        """
        longest = 2 * sorted(self._cycles)[len(self._cycles) // 2]
        counted = [one for one in self._cycles if one <= longest]
        mean = sum(counted) / len(counted)
        self.cycles_per_sample = mean if min(mean, self.period_ns / fastest_ns) > _SLOW else 1.0


class CycleCut:
    """Finds the frames that begin a cycle.

    Parameters
    ----------
    messages : number of messages
    period_ns : longest period of load cells that send irregularly, ns, whose first frame begins a cycle; 0:
        estimated, and frames before the first cycle whose begin is known are in none

    Attributes
    ----------
    paces : times of each message
    period_ns : given, or that of the fastest message; 0: unknown
    number : of the newest cycle
    is_aligned : whether frames are in cycles: the first of one was received since the start, or since the cut
        moved
    """

    def __init__(self, messages: int, period_ns: int) -> None:
        self.paces = [Pace() for _ in range(messages)]
        self.period_ns, self._is_estimated = period_ns, not period_ns
        self.number = 0
        self.is_aligned = period_ns > 0
        self._first: Pace | None = None  # message with which cycles begin; None: unknown
        self._behind: Pace | None = None  # message behind the largest gap
        self._begin_ns = 0  # of the newest cycle, also if its first frame was lost
        self._last_ns = 0  # stamp of the newest frame
        self._before_ns = 0  # gap before the newest cycle
        self._gap_ns = 0  # largest gap since
        self._received = self._received_before = 0  # number of frames until now, until the newest cycle
        self._size = 0  # frames of the cycle before
        self._restarted = 0  # number of frames until the largest gap was searched
        self._confirmed = 1

    def restart(self, first: Pace | None = None) -> None:
        """Wait for the first frame of a cycle: of message ``first``, by default the one until now."""
        self._first, self._gap_ns, self._confirmed = first or self._first, 0, 0
        self._restarted = self._received
        self.is_aligned = self._first is None and not self._is_estimated

    def begins(self, pace: Pace, stamp_ns: int, samples: int, is_due: bool) -> bool:
        """Whether a frame begins a cycle.

        Parameters
        ----------
        pace : of its message
        stamp_ns : its receive time, ns
        samples : by which its counter is ahead of the frame before
        is_due : whether the newest cycle is closed, or has a frame of its message
        """
        gap_ns, self._last_ns = stamp_ns - self._last_ns, stamp_ns
        if not 0 <= gap_ns <= PAUSE_NS:  # as at the first frame, or when the clock was set
            gap_ns = self._before_ns
        begins = False
        if self.is_aligned and (is_due or self._is_next(pace, stamp_ns, samples)):
            self._confirmed = self._confirmed + 1 if self._gap_ns > _LARGER * self._before_ns else 0
            is_early = self._is_estimated and self.number <= _EACH
            begins = self._confirmed < (2 if is_early else _CONFIRMATIONS)
            if not begins:
                self.restart(self._behind)
        elif self._gap_ns < gap_ns:
            self._gap_ns, self._behind = gap_ns, pace
        if not self.is_aligned:
            if pace.received > self._restarted:  # all messages were received since, or are silent
                self.restart(self._behind)
            begins, pace.lag_ns = pace is self._first, 0
        if begins:
            self._first, self._begin_ns, self.is_aligned = pace, stamp_ns - pace.lag_ns, True
            self._before_ns, self._gap_ns = gap_ns, 0
            self.number += 1
            self._size, self._received_before = self._received - self._received_before, self._received
        self._received += 1
        pace.received, pace.lag_ns = self._received, stamp_ns - self._begin_ns
        return begins

    def cycles_since(self, pace: Pace, stamp_ns: int) -> int:
        """Number of cycles from the newest frame of a message to one received at ``stamp_ns``."""
        is_behind = 2 * (stamp_ns - self._begin_ns - pace.lag_ns) > self._before_ns
        return self.number - pace.cycle + is_behind

    def _is_next(self, pace: Pace, stamp_ns: int, samples: int) -> bool:
        """Whether a frame is not of the newest cycle, of which the frame of its message was lost."""
        if self.cycles_since(pace, stamp_ns) == self.number - pace.cycle:
            return False
        most = 1.5 * pace.cycles_per_sample * max(1, self._size - 1)  # since its frame before
        has_missed = pace.measured >= _EACH and self._received - pace.received > most
        return samples > 1 or has_missed  # else the whole bus is late

    def note(self, pace: Pace, stamp_ns: int, samples: int) -> bool:
        """Follow the periods with a frame; returns whether one was estimated."""
        is_due = pace.last_ns > 0 and pace.note(stamp_ns - pace.last_ns, self.number - pace.cycle, samples)
        if is_due:
            pace.estimate()
            if pace.measured >= _EACH:
                sending = [
                    one.period_ns
                    for one in self.paces
                    if one.measured >= _EACH and stamp_ns - one.last_ns < _INTERVALS * one.period_ns
                ]
                fastest_ns = round(min(*sending, pace.period_ns, LONGEST_PERIOD_NS))
                pace.compare(fastest_ns)
                if self._is_estimated:
                    self.period_ns = fastest_ns
        pace.last_ns = stamp_ns
        pace.cycle = self.number if self.is_aligned else pace.cycle
        return is_due


def _usual(intervals: Sequence[float]) -> float:
    """Usual interval: the mean of those near the median, without losses and delays.

    If frames come in lumps the median is far from the mean, which is then the answer.
    """
    median, mean = sorted(intervals)[(len(intervals) - 1) // 2], sum(intervals) / len(intervals)
    if not 0.5 * mean <= median <= 1.25 * mean:
        return mean
    near = [one for one in intervals if abs(one - median) <= 0.25 * median]
    return sum(near) / len(near)
