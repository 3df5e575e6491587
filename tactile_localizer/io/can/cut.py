"""Cut of the frames on a bus into cycles: which frame is the first of a cycle.

Every load cell sends once per cycle, in an order that lasts. So a cycle ends when one of them sends again, at
any pace, and however late the bus delivers. Time decides only which frame comes first, and of which cycle a
frame is before which others were lost: the first frame is the one behind the largest gap, which is followed
as the phases of the load cells drift. Frames before the first cycle whose begin is known are in none.

Without counters, a frame behind losses is not distinguishable from one that is late with the whole bus, as
long as none was received that usually follows it. It is taken as late, so that one cycle can mix samples.
"""

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
"""Cycles in a row with a larger gap before one message after which they begin with it; at the start, as many
as there are."""


@dataclass(slots=True, eq=False)
class Pace:
    """Times of the frames of one message.

    Attributes
    ----------
    last_ns : stamp of the newest frame, ns; 0 before the first
    cycle : number of its cycle
    lag_ns : time from the begin of that cycle, ns; ``None``: unknown
    gaps_ns : gaps before its newest frames, ns
    period_ns : usual time between two samples, ns; 0: unknown
    cycles_per_sample : 1.0 unless the load cell is slower than the fastest one; 0.0: unknown
    """

    last_ns: int = 0
    cycle: int = 0
    lag_ns: int | None = None
    gaps_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_CONFIRMATIONS))
    period_ns: float = 0.0
    cycles_per_sample: float = 0.0
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
    period_ns : longest period of load cells that send irregularly, ns; 0: estimated

    Attributes
    ----------
    paces : times of each message
    period_ns : given, or that of the fastest message; 0: unknown
    last_ns : stamp of the newest frame, ns
    number : of the newest cycle
    moves : number of times that another message became the first of the cycles
    is_aligned : whether frames are in cycles: the first of one was received since the start, or since the cut
        moved
    is_known : whether cycles begin where they should: some in a row have had no larger gap since the start,
        or since a pause. Before, a frame that is in no cycle is not lost
    """

    def __init__(self, messages: int, period_ns: int) -> None:
        self.paces = [Pace() for _ in range(messages)]
        self.period_ns, self._is_estimated = period_ns, not period_ns
        self.last_ns = self.number = self.moves = 0
        self.is_aligned = self.is_known = False
        self._confirmed = 0  # cycles in a row without a larger gap
        self._first: Pace | None = None  # message with which cycles begin; None: unknown
        self._behind = self.paces[0]  # message behind the largest gap within the newest cycle
        self._searched: set[Pace] = set()  # messages received since the first one is waited for
        self._begin_ns = 0  # of the newest cycle, also if its first frame was lost
        self._passed_ns = 0  # usual lag of that frame of it which is usually the last
        self._late_ns = 0  # time by which it was later in its cycle than usual
        self._gaps_ns: deque[int] = deque(maxlen=_CONFIRMATIONS)  # before the newest cycles
        self._durations_ns: deque[int] = deque(maxlen=_CONFIRMATIONS)  # of the newest cycles
        self._gap_ns = 0  # largest within the newest one

    def restart(self, first: Pace | None = None) -> None:
        """Wait for the first frame of a cycle: of message ``first``, by default the one until now."""
        self.is_known = first is not None and self.is_known
        self.is_aligned, self._gap_ns, self._confirmed = False, 0, 0
        self._searched.clear()
        if first is not None:
            self._first, self.moves = first, self.moves + 1
            for pace in self.paces:
                pace.lag_ns = None

    def take(self, pace: Pace, stamp_ns: int, samples: int, is_due: bool) -> bool:
        """Follow the cycles and periods with a frame; returns whether it begins a cycle.

        Parameters
        ----------
        pace : of its message
        stamp_ns : its receive time, ns
        samples : by which its counter is ahead of the frame before
        is_due : whether the newest cycle is closed, or has a frame of its message
        """
        gap_ns, self.last_ns = stamp_ns - self.last_ns, stamp_ns
        if not 0 <= gap_ns <= PAUSE_NS:  # as at the first frame, or when the clock was set
            gap_ns = PAUSE_NS
        pace.gaps_ns.append(gap_ns)
        begins = self.is_aligned and (is_due or self._is_next(pace, stamp_ns, samples))
        has_larger = begins and self._gap_ns > _LARGER * self._gaps_ns[-1]
        if begins:
            self._confirmed = 0 if has_larger else self._confirmed + 1
            self.is_known |= self._confirmed >= _CONFIRMATIONS
        if has_larger and self._is_misplaced():
            self.restart(self._behind)
        elif not begins and gap_ns > self._gap_ns:
            self._gap_ns, self._behind = gap_ns, pace
        if not self.is_aligned:
            begins = self._is_first(pace)
        cycles = self.number + begins - pace.cycle
        if begins:
            self._first, self.is_aligned, self.number = pace, True, self.number + 1
            begin_ns = stamp_ns - (pace.lag_ns or 0)
            self._durations_ns.append(begin_ns - self._begin_ns if self._begin_ns else gap_ns)
            self._begin_ns = begin_ns
            self._gaps_ns.append(gap_ns)
            self._gap_ns = self._passed_ns = 0
        if self.is_aligned:
            lag_ns = stamp_ns - self._begin_ns
            if pace.lag_ns is not None:
                self._late_ns = lag_ns - pace.lag_ns
                self._passed_ns = max(self._passed_ns, pace.lag_ns)
            pace.lag_ns, pace.cycle = lag_ns, self.number
        if pace.last_ns and pace.note(stamp_ns - pace.last_ns, cycles, samples):
            self._estimate(pace, stamp_ns)
        pace.last_ns = stamp_ns
        return begins

    def cycles_since(self, pace: Pace, stamp_ns: int) -> int:
        """Number of cycles from the newest frame of a message to one received at ``stamp_ns``."""
        return self.number - pace.cycle + self._is_behind(pace, stamp_ns)

    def take_into_previous(self, pace: Pace, stamp_ns: int) -> bool:
        """Take a frame of the cycle before, which lacks it, if it is one; returns whether it is.

        The first frame of the newest cycle overtook it, so it is earlier than usual in that one.
        """
        if pace.lag_ns is None or pace.cycle >= self.number - 1 or pace.cycles_per_sample > 1.0:
            return False
        early_ns = self._begin_ns + pace.lag_ns - stamp_ns
        if 2 * early_ns <= self._shortest_ns():
            return False
        pace.last_ns, pace.cycle, pace.lag_ns = stamp_ns, self.number - 1, None
        return True

    def _is_behind(self, pace: Pace, stamp_ns: int) -> bool:
        """Whether a frame is later in the newest cycle than usual, and than the one before it."""
        if pace.lag_ns is None:
            return False
        late_ns = stamp_ns - self._begin_ns - pace.lag_ns - self._late_ns
        return 2 * late_ns > self._shortest_ns()

    def _shortest_ns(self) -> int:
        """Period of the cycles: the usual one, or if shorter the longest of the newest ones."""
        return min(max(self._durations_ns), self.period_ns or LONGEST_PERIOD_NS)

    def _is_next(self, pace: Pace, stamp_ns: int, samples: int) -> bool:
        """Whether a frame is not of the newest cycle, of which the frame of its message was lost.

        If none was lost, all are late: then none was received that usually follows.
        """
        was_passed = (pace.lag_ns or 0) < self._passed_ns and pace.cycles_per_sample <= 1.0
        return (samples > 1 or was_passed) and self._is_behind(pace, stamp_ns)

    def _is_misplaced(self) -> bool:
        """Whether cycles should begin elsewhere: the gap before another message has been larger in several.

        Cycles that a sender sends at once, after it was put aside, have gaps of no meaning.
        """
        period_ns = min((pace.period_ns for pace in self.paces if pace.measured >= _EACH), default=0.0)
        are_in_time = 2.0 * max(self._durations_ns) > period_ns
        return are_in_time and min(self._behind.gaps_ns) > _LARGER * max(self._gaps_ns)

    def _is_first(self, pace: Pace) -> bool:
        """Whether a frame is that which is waited for: by default, of the message behind the largest gap."""
        if pace in self._searched:  # all were received since, or are silent
            self.restart(max(self._searched, key=lambda one: one.gaps_ns[-1]))
        self._searched.add(pace)
        return pace is self._first

    def _estimate(self, pace: Pace, stamp_ns: int) -> None:
        """Estimate the period of a message, and of the fastest one."""
        pace.estimate()
        if pace.measured < _EACH:
            return
        sending = [
            one.period_ns
            for one in self.paces
            if one.measured >= _EACH and stamp_ns - one.last_ns < _INTERVALS * one.period_ns
        ]
        fastest_ns = round(min(*sending, pace.period_ns, LONGEST_PERIOD_NS))
        pace.compare(fastest_ns)
        if self._is_estimated:
            self.period_ns = fastest_ns


def _usual(intervals: Sequence[float]) -> float:
    """Usual interval: the mean of those near the median, without losses and delays.

    If frames come in lumps the median is far from the mean, which is then the answer.
    """
    median, mean = sorted(intervals)[(len(intervals) - 1) // 2], sum(intervals) / len(intervals)
    if not 0.5 * mean <= median <= 1.25 * mean:
        return mean
    near = [one for one in intervals if abs(one - median) <= 0.25 * median]
    return sum(near) / len(near)
