"""Assembly of frames into cycles: the strain of all phalanges at one time.

Load cells send once per period, in a burst or each at a time of its own. Cycles are cut in the middle of the
largest gap between their frames, which is followed as their phases drift. A cycle closes at the cut, when all
its frames have been received, or when a load cell sends its next sample. A phalanx without a complete sample
is ``MISSING`` and its voltages are NaN.

Counters do not cut cycles. They count losses, and reveal frames of one load cell that belong to two samples.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import can
import numpy as np

from tactile_localizer.io.can.counter import MAX_LATE, RollingCounter
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, SATURATED

SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS = 500_000, 1_000_000_000
"""Range of estimated periods, ns: 2 kHz to 1 Hz."""

PAUSE_NS = 2 * LONGEST_PERIOD_NS
"""Silence of the whole bus from which the hand may have been off: nothing is lost, counters begin anew."""

TOLERANCE = 1 / 16
"""Fraction of a period from which a frame is delayed, or ahead of a delay."""

INTERVALS = 64
"""Number of intervals from which the period of a message is estimated."""

EACH = 16
"""Number of samples after which that is done again."""

SLOW = 1.2
"""Ratio of the periods from which a load cell is reported to be slower than the fastest one."""

LARGER = 1.5
"""Ratio from which a gap between frames is larger than that of the cut, or a period is certainly longer."""

FLUSHED = 3
"""Number of periods of silence after which an open cycle is closed."""

RELIABLE = 100
"""Number of periods without a frame for which the cut is continued."""

CONFIRMATIONS = 8
"""Cycles in a row after which the cut moves to a larger gap, or the counters of two messages are separate."""


@dataclass(frozen=True)
class Cycle:
    """Strain of F phalanges in one cycle of the load cells.

    Attributes
    ----------
    stamp_ns : receive time of the first frame, ns
    strain : (C,) V; NaN where missing
    status : (F,) uint8 bits of :mod:`~tactile_localizer.io.status`
    sequence : (F,) uint32, number of the sample by the load cell's counter; of the cycle if it has no counter
    """

    stamp_ns: int
    strain: np.ndarray
    status: np.ndarray
    sequence: np.ndarray


@dataclass
class PhalanxCounts:
    """Totals of one phalanx.

    Attributes
    ----------
    samples : complete samples
    missing : cycles without voltages of this phalanx
    drops : frames sent that are in no cycle, according to the counter
    jumps : frames whose counter neither continues nor shows losses: a restart, or two senders with the same
        identifiers
    saturated, faults : samples with that status
    last_ns : receive time of the last frame used, ns; 0 before the first
    cycles_per_sample : period of the load cell in cycles, which are as fast as the fastest one
    counter : reason why its counter is not used, continuing "the counter"; else empty
    """

    samples: int = 0
    missing: int = 0
    drops: int = 0
    jumps: int = 0
    saturated: int = 0
    faults: int = 0
    last_ns: int = 0
    cycles_per_sample: float = 1.0
    counter: str = ""


@dataclass
class BusCounts:
    """Totals since the assembler was created.

    Attributes
    ----------
    phalanges : totals of each phalanx
    frames : number of frames of each kind; every frame has exactly one kind
    cycles : number of cycles
    misfits : newest frame not used, by the message that it has or resembles the identifier of; -1: none
    suspects : data of the newest cycle in which a phalanx was ``SATURATED`` or ``FAULT``
    """

    phalanges: list[PhalanxCounts]
    frames: list[int] = field(default_factory=lambda: [0] * len(FrameKind))
    cycles: int = 0
    misfits: dict[int, can.Message] = field(default_factory=dict)
    suspects: dict[int, bytes] = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class _Stream:
    """Frames of one message.

    Attributes
    ----------
    cell : load cell that sends it
    place : of its data in those of a cycle
    last_ns, sent_ns : stamp of the newest frame, and without the delay of the bus; 0 before the first
    sequence : number of the sample
    cycle : number of the newest cycle with a frame
    value, samples : value of the counter of that frame, and samples by which it is ahead of the one before
    lead : usual difference of its counter from that of the load cell's first message; ``None``: unknown
    intervals, measured : newest times between two samples, ns, and the number of all
    period_ns, tolerance_ns : usual interval, and deviation that is no delay; 0: unknown
    """

    cell: _LoadCell = field(repr=False)
    place: slice
    counter: RollingCounter | None
    last_ns: int = 0
    sent_ns: int = 0
    sequence: int = 0
    cycle: int = 0
    value: int = 0
    samples: int = 1
    lead: int | None = None
    intervals: deque[float] = field(default_factory=lambda: deque(maxlen=INTERVALS))
    measured: int = 0
    period_ns: float = 0.0
    tolerance_ns: float = 0.0


@dataclass(slots=True, eq=False)
class _LoadCell:
    """Messages of one load cell.

    Attributes
    ----------
    is_common : whether its messages were seen to share a counter: it was equal again after a loss in one
    torn : number of cycles in a row whose frames are of different samples by the counters
    """

    streams: list[_Stream] = field(default_factory=list)
    counts: PhalanxCounts = field(default_factory=PhalanxCounts)
    is_common: bool = False
    torn: int = 0

    def is_whole(self, cycle: int) -> bool:
        """Whether a cycle has a frame of each message."""
        return all(stream.cycle == cycle for stream in self.streams)

    def settle(self) -> bool:
        """Decide that the counters are separate, unless a common one was seen; returns whether they are."""
        self.torn += 1
        if self.is_common and self.torn < CONFIRMATIONS:
            return False
        for stream, counter, lead in self.leads():
            behind = round(abs(lead) / counter.step)
            self.counts.drops += behind if counter.is_sure and behind <= MAX_LATE else 0
            stream.lead = (stream.lead or 0) + lead
        self.torn, self.is_common = 0, False
        return True

    def leads(self) -> list[tuple[_Stream, RollingCounter, int]]:
        """Messages whose newest frame is not of the sample of the first message's, and by how much."""
        first = self.streams[0].counter
        found = []
        for stream in self.streams[1:]:
            if (
                stream.lead == stream.value - self.streams[0].value
                and stream.samples == self.streams[0].samples
            ):
                continue
            own = stream.counter
            if first is None or own is None or first.span != own.span or not first.step == own.step > 0:
                continue
            if stream.lead is None:
                stream.lead = own.ahead_of(stream.value, self.streams[0].value)
            lead = own.ahead_of(stream.value, self.streams[0].value + stream.lead)
            if 2 * abs(lead) > own.step:
                found.append((stream, own, lead))
            elif stream.samples != self.streams[0].samples:
                self.is_common = True
        if not found:
            self.torn = 0
        return found


class CycleAssembler:
    """Assembles frames into cycles.

    Parameters
    ----------
    protocol : layout of the frames
    period_s : longest period of load cells that send irregularly, s; 0: estimated, as that of the fastest
        load cell, and frames before the first cycle whose begin is known are discarded
    """

    def __init__(self, protocol: LoadCellProtocol, period_s: float = 0.0) -> None:
        self._cells = [_LoadCell() for _ in protocol.phalanges]
        self._streams = []
        for slot, message in enumerate(protocol.messages):
            cell = self._cells[message.phalanx]
            counter = RollingCounter(len(message.counter_values)) if message.counter else None
            cell.streams.append(_Stream(cell, protocol.bytes_of(slot), counter))
            self._streams.append(cell.streams[-1])
        self._paired = [cell for cell in self._cells if len(cell.streams) > 1]
        self.counts = BusCounts([cell.counts for cell in self._cells])
        self._protocol = protocol
        self._is_estimated = not period_s
        self.period_ns = self._fastest_ns = round(period_s * 1e9)  # 0: not estimated yet
        self._data = bytearray(protocol.size)  # of the frames of the open cycle
        self._cycles: list[Cycle] = []  # closed, not yet returned
        self._is_open = False
        self._number = 0  # of the newest cycle
        self._first_ns = 0  # stamp of its first frame
        self._awaited = 0  # its frames not yet received
        self._last_ns = self._sent_ns = 0  # stamp of the newest frame, and without the delay
        self._delay_ns = 0  # of the whole bus, whose frames then come in a burst
        self._cut_ns = 0  # end of the newest cycle, without the delay
        self._gap_ns = self._middle_ns = 0  # largest gap between frames since the last cut
        self._leader: _Stream | None = None  # first message of the cycles, until the period is known
        self._border_ns = 0  # gap before it
        self._opener = self._streams[0]  # first message of the newest cycle
        self._behind = self._streams[0]  # message behind the largest gap
        self._confirmed = 1  # number of cycles in a row with a larger gap than that of the cut
        self._torn: list[_LoadCell] = []  # load cells whose frames in the open cycle are of different samples
        self._is_aligned = not self._is_estimated  # whether the cut has passed since it moved

    def reset(self) -> None:
        """Close the open cycle and forget the counters, as after a pause. Totals and the period are kept."""
        self._close()
        self._delay_ns = 0
        for stream in self._streams:
            stream.last_ns = 0
            if stream.counter is not None:
                stream.counter.newest = None

    def has_received(self, slot: int) -> bool:
        """Whether frames of a message were received since the last pause."""
        return bool(self._streams[slot].last_ns)

    def feed(self, frames: Sequence[can.Message], oldest_ns: int = 0) -> list[Cycle]:
        """Process frames in order of reception; returns the cycles that they complete or close.

        Frames stamped before ``oldest_ns`` are discarded as late.
        """
        for frame in frames:
            is_late = frame.timestamp * 1e9 < oldest_ns
            self.counts.frames[FrameKind.LATE if is_late else self._take(frame)] += 1
        cycles, self._cycles = self._cycles, []
        return cycles

    def flush(self, now_ns: int) -> list[Cycle]:
        """Close the open cycle if none of the frames after its end was received by ``now_ns``; returns it.

        ``now_ns`` is of the clock of the frames. The last frames may be delayed, or read late.
        """
        if self.remaining_ns(now_ns) == 0:
            self._close()
        return self.feed([])

    def remaining_ns(self, now_ns: int) -> int | None:
        """Time from ``now_ns`` until the open cycle is flushed, ns; ``None`` if none is open."""
        if not self._is_open:
            return None
        silence_ns = FLUSHED * (self.period_ns or LONGEST_PERIOD_NS)
        remaining_ns = self._cut_ns + self._delay_ns + silence_ns - now_ns
        is_near = 0 < remaining_ns <= silence_ns + 2 * self.period_ns  # else the clock was set back
        return remaining_ns if is_near else 0

    def _take(self, frame: can.Message) -> FrameKind:
        """Use a frame; returns its kind, or the reason why it is not used."""
        kind, slot, value = self._protocol.classify(frame)
        if kind:
            if kind != FrameKind.ERROR:
                self.counts.misfits[slot] = frame
            return kind
        stream = self._streams[slot]
        stamp_ns = int(frame.timestamp * 1e9)
        gap_ns = stamp_ns - self._last_ns
        if abs(gap_ns) > PAUSE_NS:
            self.reset()
        samples = 1
        if stream.counter is not None and not stream.counter.follows(value):
            samples = self._advance(stream, stream.counter, value, stamp_ns)
            if samples <= 0:
                return FrameKind.OUT_OF_ORDER if samples else FrameKind.DUPLICATE
        stream.sequence += samples
        is_next = stream.last_ns > 0
        if is_next:
            self._note_interval(stream, stamp_ns, samples, gap_ns)
        stream.last_ns = stream.cell.counts.last_ns = self._last_ns = stamp_ns
        sent_ns = stamp_ns - self._delay_ns
        gap_ns = sent_ns - self._sent_ns
        stream.sent_ns = self._sent_ns = sent_ns
        if self._is_first(stream, is_next, gap_ns):
            self._pass_cut(stream, sent_ns, gap_ns)
        elif self._gap_ns < gap_ns <= PAUSE_NS:
            self._gap_ns, self._middle_ns, self._behind = gap_ns, sent_ns - gap_ns // 2, stream
        if self._is_aligned:
            self._place(stream, frame, value, samples)
        return FrameKind.DATA

    def _advance(self, stream: _Stream, counter: RollingCounter, value: int, stamp_ns: int) -> int:
        """Samples by which a frame is ahead of the newest of its message; counts those between as lost."""
        if counter.newest is None:
            counter.advance(value, 1.0, 1.0)
            stream.sequence += (value - stream.sequence) % counter.span - 1
            return 1
        counts, jumps = stream.cell.counts, counter.jumps
        cycles: float = self._number - stream.cycle
        if counts.cycles_per_sample > LARGER:  # else the same rate, estimated irregularly
            cycles /= counts.cycles_per_sample
        elapsed_ns = stamp_ns - stream.last_ns
        periods = elapsed_ns / (stream.period_ns or self._fastest_ns or elapsed_ns or 1)
        # While the others send, their cycles are more exact than the time.
        samples = counter.advance(value, cycles if cycles > 1 else periods, max(periods, cycles))
        counts.drops += max(0, samples - 1)
        counts.jumps += counter.jumps - jumps
        counts.counter = counter.problem
        return samples

    def _note_interval(self, stream: _Stream, stamp_ns: int, samples: int, gap_ns: int) -> None:
        """Follow the period of a message and the delay of the whole bus.

        The delay is how late a frame is if none was lost. It grows if no frame was received meanwhile (else
        some were lost), and shrinks with each frame of the burst that follows.
        """
        stream.intervals.append((stamp_ns - stream.last_ns) / samples)
        stream.measured += 1
        if stream.measured <= EACH or not stream.measured % EACH:
            self._estimate_period(stream, stamp_ns)
        if not self.period_ns or stream.measured < EACH:
            return
        late_ns = stamp_ns - stream.sent_ns - samples * stream.period_ns
        change_ns = late_ns - self._delay_ns
        if change_ns < -stream.tolerance_ns or stream.tolerance_ns < change_ns <= gap_ns:
            self._delay_ns = max(0, round(late_ns))

    def _estimate_period(self, stream: _Stream, stamp_ns: int) -> None:
        """Estimate the period of a message, and of the cycles."""
        stream.period_ns = max(_usual(stream.intervals), SHORTEST_PERIOD_NS)
        stream.tolerance_ns = TOLERANCE * stream.period_ns
        if stream.measured < EACH:
            return
        sending = [
            one.period_ns
            for one in self._streams
            if one.measured >= EACH and stamp_ns - one.last_ns < INTERVALS * one.period_ns
        ]
        self._fastest_ns = round(min(*sending, stream.period_ns, LONGEST_PERIOD_NS))
        if self._is_estimated:
            if not self.period_ns:  # the first cut is a period after the middle of the last gap
                self._cut_ns = self._opener.sent_ns - self._border_ns // 2 + self._fastest_ns
            self.period_ns = self._fastest_ns
        ratio = stream.period_ns / self._fastest_ns
        stream.cell.counts.cycles_per_sample = ratio if ratio > SLOW else 1.0

    def _is_first(self, stream: _Stream, is_next: bool, gap_ns: int) -> bool:
        """Whether a frame is the first of a cycle: behind the cut, or by its message at the start."""
        if self.period_ns:
            return not 0 < self._cut_ns - self._sent_ns <= 2 * self.period_ns
        if self._leader is None:
            return is_next
        if stream is not self._leader:
            return False
        if not self._is_aligned or 2 * gap_ns > self._border_ns:
            return True
        if self._is_open:
            self._leader = self._opener  # which is about as early
        return False

    def _place(self, stream: _Stream, frame: can.Message, value: int, samples: int) -> None:
        """Use a frame in the open cycle, or in a new one."""
        if self._is_open and stream.cycle == self._number:  # its next sample
            if self._awaited or stream.cell not in self._torn:
                self._close()
            else:  # the frame before was late
                self.counts.frames[FrameKind.DATA] -= 1
                self.counts.frames[FrameKind.OUT_OF_ORDER] += 1
                stream.cell.counts.drops += 1
                self._awaited = 1
        if not self._is_open:
            self._is_open = True
            self._number += 1
            self._first_ns, self._opener = self._last_ns, stream
            self._awaited = len(self._streams)
            if not self._is_estimated:  # the load cells may send more often, and irregularly
                self._cut_ns = max(self._cut_ns, self._sent_ns + self.period_ns // 2)
        stream.cycle, stream.value, stream.samples = self._number, value, samples
        self._data[stream.place] = frame.data
        self._awaited -= 1
        if not self._awaited:
            self._torn = [cell for cell in self._paired if cell.leads()]
            if not self._torn:  # else the right frames can still come
                self._close()

    def _pass_cut(self, stream: _Stream, sent_ns: int, gap_ns: int) -> None:
        """Close the cycle with the first frame behind its end, and find the next end."""
        self._close()
        period_ns = self.period_ns
        gap_ns = gap_ns if 0 <= gap_ns < (period_ns or PAUSE_NS) else period_ns
        passed, late_ns = divmod(sent_ns - self._cut_ns, period_ns or PAUSE_NS)
        if not period_ns or not 0 <= passed < RELIABLE:
            self._cut_ns = sent_ns + period_ns - gap_ns // 2
        elif passed:
            self._cut_ns += (passed + 1) * period_ns
        else:  # follow the middle of the gap
            error_ns = late_ns - gap_ns // 2
            self._cut_ns += period_ns + max(-period_ns, min(period_ns, error_ns)) // 4
        self._leader, self._border_ns = stream, gap_ns
        self._confirmed = self._confirmed + 1 if self._gap_ns > LARGER * gap_ns else 0
        self._is_aligned = self._confirmed < (CONFIRMATIONS if period_ns else 2)
        if not self._is_aligned:
            self._leader, self._border_ns = self._behind, self._gap_ns
            self._cut_ns = self._middle_ns + period_ns
            self._confirmed = 0
        self._gap_ns = 0

    def _close(self) -> None:
        if not self._is_open:
            return
        self._is_open = False
        if self._awaited:
            self._torn = [cell for cell in self._paired if cell.is_whole(self._number) and cell.leads()]
        strain, status = self._protocol.decode(self._data)
        for p, cell in enumerate(self._cells):
            is_whole = not self._awaited or cell.is_whole(self._number)
            if is_whole and (cell not in self._torn or cell.settle()):
                cell.counts.samples += 1
            else:
                cell.counts.missing += 1
                strain[self._protocol.channels.slices[p]] = np.nan
                status[p] = MISSING
        if status.any():
            for p, (cell, bits) in enumerate(zip(self._cells, status, strict=True)):
                if bits & (SATURATED | FAULT):
                    self.counts.suspects[p] = bytes(self._data)
                cell.counts.saturated += bool(bits & SATURATED)
                cell.counts.faults += bool(bits & FAULT)
        self.counts.cycles += 1
        first = [cell.streams[0] for cell in self._cells]
        numbers = [stream.sequence if stream.counter else self._number for stream in first]
        sequence = np.array(numbers).astype(np.uint32)
        self._cycles.append(Cycle(self._first_ns, strain, status, sequence))


def _usual(intervals: Sequence[float]) -> float:
    """Usual interval: the mean of those near the median, without losses and delays.

    If frames come in lumps the median is far from the mean, which is then the answer.
    """
    median, mean = sorted(intervals)[(len(intervals) - 1) // 2], sum(intervals) / len(intervals)
    if not 0.5 * mean <= median <= 1.25 * mean:
        return mean
    near = [one for one in intervals if abs(one - median) <= 0.25 * median]
    return sum(near) / len(near)
