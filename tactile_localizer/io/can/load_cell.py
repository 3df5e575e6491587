"""Completion of the samples of one load cell, each of a frame of each of its messages.

Frames belong to one sample if their counters say so. Where these say nothing, samples begin with the message
that usually comes behind the largest gap, or with one that comes again. Which counters are of one sample is
learned from samples that the time shows.
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from tactile_localizer.io.can.counter import MAX_LATE, RollingCounter

SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS = 500_000, 1_000_000_000
"""Range of estimated periods, ns: 2 kHz to 1 Hz."""

_LARGER = 1.5
"""Ratio from which a gap is larger than another."""

GAPS = 4
"""Number of gaps in a row that are larger before something else is taken as the end of a burst."""

_CONFIRMATIONS = 8
"""Samples in a row whose counters disagree, after which those that were seen to be a common one are not."""

_INTERVALS = 64
"""Number of intervals from which the period is estimated."""

_EACH = 16
"""Number of samples after which that is done again."""

_SLOW = 1.2
"""Number of vectors per sample from which a load cell is slower than the fastest one."""


@dataclass
class PhalanxCounts:
    """Totals of one phalanx.

    Attributes
    ----------
    samples : complete samples
    missing : cycles without voltages of this phalanx
    drops : frames sent that were not received, according to the counter
    jumps : frames whose counter neither continues nor shows losses: a restart, or two senders with the same
        identifiers
    saturated, faults : samples with that status
    last_ns : receive time of the last frame used, ns; 0 before the first
    cycles_per_sample : usual number of cycles, which are as fast as the fastest load cell; 1.0 unless slower,
        0.0: not known yet
    counter : reason why its counter is not used, continuing "the counter"; else empty
    """

    samples: int = 0
    missing: int = 0
    drops: int = 0
    jumps: int = 0
    saturated: int = 0
    faults: int = 0
    last_ns: int = 0
    cycles_per_sample: float = 0.0
    counter: str = ""


class Taken(enum.Enum):
    """What a frame does to the samples of its load cell."""

    PART = enum.auto()
    WHOLE = enum.auto()
    LATE = enum.auto()


@dataclass(slots=True, eq=False)
class Stream:
    """Frames of one message.

    Attributes
    ----------
    cell : load cell that sends it
    place : of its data in those of a vector
    counter : its counter, ``None`` without one
    sequence : number of the sample
    newest_ns, cycle : stamp of the newest frame, ns, 0 before the first, and number of its cycle
    value, samples : value of the counter of that frame, and samples by which it is ahead of the one before
    gaps_ns : gaps before its newest frames since another one of the load cell, ns
    lead : difference of its counter from that of the load cell's first message; ``None``: unknown
    apart, times : samples by which its counter was ahead of the others, and how many times in a row
    """

    cell: LoadCell = field(repr=False)
    place: slice
    counter: RollingCounter | None
    sequence: int = 0
    newest_ns: int = 0
    cycle: int = 0
    value: int = 0
    samples: int = 1
    gaps_ns: deque[int] = field(default_factory=lambda: deque(maxlen=GAPS))
    lead: int | None = None
    apart: int = 0
    times: int = 0


@dataclass(slots=True, eq=False)
class LoadCell:
    """Messages of one load cell, its newest sample, and its pace.

    Attributes
    ----------
    streams : one for each message
    counts : totals
    begin_ns, end_ns : stamps of the first and last frame of the newest sample, ns
    lag_ns : time from the begin of its newest cycle to its sample, ns; ``None``: unknown
    gaps_ns : gaps before its newest samples since one of any load cell, ns
    cycle, sequence : numbers of the cycle of its newest sample, and of that sample
    period_ns : usual time between two samples, ns; 0: unknown
    given_up_ns : begin of the sample that its newest frame showed to be incomplete, ns; 0: none
    """

    streams: list[Stream] = field(default_factory=list)
    counts: PhalanxCounts = field(default_factory=PhalanxCounts)
    begin_ns: int = 0
    end_ns: int = 0
    lag_ns: int | None = None
    gaps_ns: deque[int] = field(default_factory=lambda: deque(maxlen=GAPS))
    cycle: int = 0
    sequence: int = 0
    period_ns: float = 0.0
    given_up_ns: int = 0
    measured: int = 0
    _intervals: deque[float] = field(default_factory=lambda: deque(maxlen=_INTERVALS))
    _cycles: deque[float] = field(default_factory=lambda: deque(maxlen=_INTERVALS))
    _first: Stream | None = None  # message with which samples begin; None: unknown
    _open: list[Stream] = field(default_factory=list)  # with a frame in the open sample
    _opened_ns: int = 0
    _value: int | None = None  # counter of the first message in the open sample; None: unknown
    _last_ns: int = 0
    _noted_ns: int = 0  # begin of the sample before, ns; 0: unknown
    _is_common: bool = False  # whether counters were equal again after a loss in one
    _reversed: int = 0  # samples in a row that did not begin with the first message

    def restart(self) -> None:
        """Forget the open sample and the counters, as after a pause."""
        self.drop()
        self._noted_ns = 0
        for stream in self.streams:
            stream.newest_ns = 0
            if stream.counter is not None:
                stream.counter.newest = None

    def drop(self) -> None:
        """Forget the open sample."""
        self._open.clear()

    def take(self, stream: Stream, stamp_ns: int) -> Taken:
        """Use a frame, whose counter is in ``stream`` already."""
        self.given_up_ns = 0
        if len(self.streams) > 1:
            taken = self._join(stream, stamp_ns)
            if taken is not Taken.WHOLE:
                return taken
            self._learn()
            self._open.clear()
        else:
            self._opened_ns = stamp_ns
        self.begin_ns, self.end_ns = self._opened_ns, stamp_ns
        return Taken.WHOLE

    def _join(self, stream: Stream, stamp_ns: int) -> Taken:
        """Take a frame into the open sample, or into a new one."""
        gap_ns, self._last_ns = min(stamp_ns - self._last_ns, LONGEST_PERIOD_NS), stamp_ns
        if 2 * (stamp_ns - stream.newest_ns) > self.period_ns:  # not of many that were sent at once
            stream.gaps_ns.append(gap_ns)
            if stream is not self._first:
                self._find_first(stream, gap_ns)
        counter, is_again, ahead, value = self._comparable(stream), stream in self._open, None, None
        if counter is not None and stream.lead is not None:
            value = stream.value - stream.lead
            if self._open and self._value is not None:
                ahead = (
                    round(counter.ahead_of(value, self._value) / counter.step) if value != self._value else 0
                )
            if ahead and not is_again and stream.samples == 1 and self._adopts(stream, counter, ahead):
                ahead = 0
        if ahead is not None and -MAX_LATE <= ahead < 0:
            return Taken.LATE
        if self._open and (is_again or ahead or (ahead is None and stream is self._first)):
            self.given_up_ns = self._opened_ns
            self._open.clear()
        if not self._open:
            if stream is not self._first and value is None:
                return Taken.PART
            self._opened_ns, self._value = stamp_ns, value
        self._open.append(stream)
        return Taken.PART if len(self._open) < len(self.streams) else Taken.WHOLE

    def _find_first(self, stream: Stream, gap_ns: int) -> None:
        """Find the message with which samples begin: behind the largest gap, several times in a row."""
        if self._first is None:
            if len(stream.gaps_ns) > 1 and all(each.gaps_ns for each in self.streams):
                self._first = max(self.streams, key=lambda each: each.gaps_ns[-1])
        elif gap_ns > _LARGER * self._first.gaps_ns[-1] and are_larger(stream.gaps_ns, self._first.gaps_ns):
            self._first = stream
            self._forget()

    def _comparable(self, stream: Stream) -> RollingCounter | None:
        """The counter of a message if it counts as the one of the first message does."""
        first, own = self.streams[0].counter, stream.counter
        if first is None or own is None or not (first.is_sure and own.is_sure):
            return None
        return own if first.span == own.span and first.step == own.step > 0 else None

    def _adopts(self, stream: Stream, counter: RollingCounter, ahead: int) -> bool:
        """Whether a message turns out to have a counter of its own, not the one that the others share."""
        stream.times = stream.times + 1 if stream.apart == ahead else 1
        stream.apart = ahead
        if stream is self.streams[0] or stream.times < (_CONFIRMATIONS if self._is_common else 1):
            return False
        stream.lead = (stream.lead or 0) + ahead * counter.step
        self._is_common = False
        self.counts.drops += abs(ahead) if abs(ahead) <= MAX_LATE else 0
        return True

    def _learn(self) -> None:
        """Learn from the open sample, which is whole, which values of the counters belong together."""
        first = self.streams[0]
        self._reversed = 0 if self._open[0] is self._first else self._reversed + 1
        if self._reversed == GAPS:
            self._forget()
        for stream in self.streams:
            stream.times = 0
            if stream.lead is None:
                counter = self._comparable(stream)
                stream.lead = None if counter is None else counter.ahead_of(stream.value, first.value)
            elif stream.samples != first.samples:
                self._is_common = True

    def _forget(self) -> None:
        """Forget which values of the counters belong together, unless they are equal, or were seen to be one.

        When the load cell or who receives its frames is held up, the time shows anything.
        """
        if not self._is_common and any(stream.lead for stream in self.streams):
            for stream in self.streams:
                stream.lead = None

    def gap_ns(self) -> int:
        """Gap before the newest sample, ns; 0: unknown."""
        return self.gaps_ns[-1] if self.gaps_ns else 0

    def note(self, cycle: int) -> bool:
        """Note the number of the cycle of the newest sample; returns whether estimates are due."""
        before_ns, self._noted_ns = self._noted_ns, self.begin_ns
        samples, self.sequence = self.streams[0].sequence - self.sequence, self.streams[0].sequence
        cycles, self.cycle = cycle - self.cycle, cycle
        if not before_ns:
            return False
        self._intervals.append((self.begin_ns - before_ns) / max(samples, 1))
        self._cycles.append(cycles / max(samples, 1))
        self.measured += 1
        if self.measured > _EACH and self.measured % _EACH:
            return False
        self.period_ns = max(_usual(self._intervals), SHORTEST_PERIOD_NS)
        return self.measured >= _EACH

    def is_sending(self, now_ns: int) -> bool:
        """Whether the load cell has a period, and has sent lately."""
        return self.measured >= _EACH and now_ns - self.end_ns < _INTERVALS * self.period_ns

    def compare(self, fastest_ns: float) -> None:
        """Estimate the number of cycles per sample.

        Counted, because that does not depend on the pace; a load cell that loses samples is not slow.
        """
        longest = 2 * sorted(self._cycles)[len(self._cycles) // 2]
        counted = [one for one in self._cycles if one <= longest]
        mean = sum(counted) / len(counted)
        is_slow = min(mean, self.period_ns / fastest_ns) > _SLOW
        self.counts.cycles_per_sample = mean if is_slow else 1.0


def are_larger(gaps_ns: deque[int], others_ns: deque[int]) -> bool:
    """Whether the newest gaps are all larger than other ones; at the start, as many as there are."""
    return min(gaps_ns) > _LARGER * max(others_ns)


def _usual(intervals: Sequence[float]) -> float:
    """Usual interval: the mean of those near the median, without losses and delays.

    If frames come in lumps the median is far from the mean, which is then the answer.
    """
    median, mean = sorted(intervals)[(len(intervals) - 1) // 2], sum(intervals) / len(intervals)
    if not 0.5 * mean <= median <= 1.25 * mean:
        return mean
    near = [one for one in intervals if abs(one - median) <= 0.25 * median]
    return sum(near) / len(near)
