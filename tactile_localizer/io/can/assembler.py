"""Assembly of the samples of load cells into cycles: the strain of all phalanges at one time.

Each load cell completes its own samples (:mod:`~tactile_localizer.io.can.load_cell`), and sends one per
cycle, in an order that lasts. So a cycle ends with the last sample that it lacks, or when a load cell
completes another one, at any pace, and however late the bus delivers. A phalanx without a sample is
``MISSING``, and its voltages are NaN.

Time decides only which load cell comes first, and of which cycle a sample is before which others were lost:
the first one is behind the largest gap, which is followed as the phases of the load cells drift. A wrong
choice costs the age of samples, and when it is mended a cycle in two parts, but never a sample, and none is
composed of two.

Without counters, a sample behind losses is not distinguishable from one that is late with the whole bus, as
long as none was received that usually follows it. It is taken as late, so that one cycle can mix samples.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import can
import numpy as np

from tactile_localizer.io.can.counter import RollingCounter
from tactile_localizer.io.can.load_cell import (
    GAPS,
    LONGEST_PERIOD_NS,
    LoadCell,
    PhalanxCounts,
    Stream,
    Taken,
    are_larger,
)
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, SATURATED

PAUSE_NS = 2 * LONGEST_PERIOD_NS
"""Silence of the whole bus from which the hand may have been off: nothing is lost, counters begin anew."""

FLUSHED = 3
"""Number of periods of silence after which an open cycle is closed."""


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


class CycleAssembler:
    """Assembles frames into cycles.

    Parameters
    ----------
    protocol : layout of the frames
    period_s : longest period of load cells that send irregularly, s; 0: estimated, as that of the fastest
        load cell

    Attributes
    ----------
    counts : totals
    period_ns : given, or that of the fastest load cell, ns; 0: not estimated yet
    """

    def __init__(self, protocol: LoadCellProtocol, period_s: float = 0.0) -> None:
        self._cells = [LoadCell() for _ in protocol.phalanges]
        self._streams = []
        for slot, message in enumerate(protocol.messages):
            cell = self._cells[message.phalanx]
            counter = RollingCounter(len(message.counter_values)) if message.counter else None
            cell.streams.append(Stream(cell, protocol.bytes_of(slot), counter))
            self._streams.append(cell.streams[-1])
        self.counts = BusCounts([cell.counts for cell in self._cells])
        self.period_ns, self._is_estimated = round(period_s * 1e9), not period_s
        self._protocol = protocol
        self._frames = bytearray(protocol.size)  # newest frames
        self._data = bytearray(protocol.size)  # of the samples in the open cycle
        self._cycles: list[Cycle] = []  # closed, not yet returned
        self._ready: list[LoadCell] = []  # those with a sample in the open cycle, in order
        # The one with which cycles begin; None: unknown.
        self._first = self._cells[0] if len(self._cells) == 1 else None
        self._next: LoadCell | None = None  # the one with which they are to begin, where that is another
        self._is_aligned = False  # whether its sample was received since the start, a pause, or a change
        self._begin_ns = 0  # of the open cycle, also if its first sample was lost
        self._passed_ns = 0  # usual lag of that sample in it which is usually the last
        self._late_ns = 0  # time by which it was later in its cycle than usual
        self._gap_ns, self._behind = 0, self._cells[0]  # largest gap in the open cycle, and what came behind
        self._gaps_ns: deque[int] = deque(maxlen=GAPS)  # before the newest cycles
        self._durations_ns: deque[int] = deque(maxlen=GAPS)  # of the newest cycles
        self._number = 0  # of the open cycle
        self._sample_ns = 0  # stamp of the newest sample
        self._frame_ns = 0  # stamp of the newest frame
        self._stamp_ns = 0  # of the newest cycle

    def reset(self) -> None:
        """Close the open cycle and forget the counters, as after a pause. Totals and the period are kept."""
        self._close()
        self._align(self._first)
        for cell in self._cells:
            cell.restart()

    def has_received(self, slot: int) -> bool:
        """Whether frames of a message were received since the last pause."""
        return bool(self._streams[slot].newest_ns)

    def feed(self, frames: Sequence[can.Message], oldest_ns: int = 0) -> list[Cycle]:
        """Process frames in order of reception; returns the cycles that they complete or close.

        Frames stamped before ``oldest_ns`` are discarded as late, and close the open cycle: what it lacks is
        late, too.
        """
        for frame in frames:
            self.counts.frames[self._take(frame, oldest_ns)] += 1
        cycles, self._cycles = self._cycles, []
        return cycles

    def flush(self, now_ns: int) -> list[Cycle]:
        """Close the open cycle if no frame was received for long by ``now_ns``; returns it.

        ``now_ns`` is of the clock of the frames. The last frames may be delayed, or read late.
        """
        if self.remaining_ns(now_ns) == 0:
            self._close()
        return self.feed([])

    def remaining_ns(self, now_ns: int) -> int | None:
        """Time from ``now_ns`` until the open cycle is flushed, ns; ``None`` if none is open."""
        if not self._ready:
            return None
        silence_ns = FLUSHED * (self.period_ns or LONGEST_PERIOD_NS)
        remaining_ns = self._frame_ns + silence_ns - now_ns
        return remaining_ns if 0 < remaining_ns <= 2 * silence_ns else 0  # else the clock was set back

    def _take(self, frame: can.Message, oldest_ns: int) -> FrameKind:
        """Use a frame; returns its kind, or the reason why it is not used."""
        kind, slot, value = self._protocol.classify(frame)
        if kind:
            if kind != FrameKind.ERROR:
                self.counts.misfits[slot] = frame
            return kind
        stream, stamp_ns = self._streams[slot], int(frame.timestamp * 1e9)
        if abs(stamp_ns - self._frame_ns) > PAUSE_NS:
            self.reset()
        self._frame_ns = stamp_ns
        cell, counter, samples = stream.cell, stream.counter, 1
        if counter is not None:
            has_wrapped = self._number - stream.cycle >= counter.span  # possibly
            if has_wrapped or not counter.follows(value):
                samples = self._advance(stream, counter, value, stamp_ns)
                if samples <= 0:
                    return FrameKind.OUT_OF_ORDER if samples else FrameKind.DUPLICATE
        stream.sequence += samples
        stream.value, stream.samples = value, samples
        cell.counts.last_ns = stamp_ns
        is_late = stamp_ns < oldest_ns
        taken = Taken.PART if is_late else cell.take(stream, stamp_ns)
        stream.newest_ns, stream.cycle = stamp_ns, self._number
        if is_late:
            cell.drop()
            self._close()
            return FrameKind.LATE
        if taken is Taken.LATE:
            return FrameKind.OUT_OF_ORDER
        self._frames[stream.place] = frame.data
        self._use(cell, taken)
        return FrameKind.DATA

    def _use(self, cell: LoadCell, taken: Taken) -> None:
        """Use the sample that a frame completes; an incomplete one of the only load cell is a cycle, too."""
        if cell.given_up_ns and len(self._cells) == 1 and self._is_aligned:
            self._close()
            self._number += 1
            self._make([], cell.given_up_ns)
        if taken is Taken.WHOLE:
            self._add(cell)

    def _advance(self, stream: Stream, counter: RollingCounter, value: int, stamp_ns: int) -> int:
        """Samples by which a frame is ahead of the newest of its message; counts those between as lost."""
        if counter.newest is None:
            counter.advance(value, 1.0, 1.0)
            stream.sequence += (value - stream.sequence) % counter.span - 1
            return 1
        counts, jumps = stream.cell.counts, counter.jumps
        cycles = (self._number - stream.cycle) / (counts.cycles_per_sample or 1.0)
        elapsed_ns = stamp_ns - stream.newest_ns
        periods = elapsed_ns / (stream.cell.period_ns or self.period_ns or elapsed_ns or 1)
        # While the others send, their cycles are more exact than the time.
        samples = counter.advance(value, cycles if cycles > 1 else periods, max(periods, cycles))
        counts.drops += max(0, samples - 1)
        counts.jumps += counter.jumps - jumps
        counts.counter = counter.problem
        return samples

    def _add(self, cell: LoadCell) -> None:
        """Use a sample in the open cycle, or in a new one."""
        if cell.cycle < self._number - 1 and self._is_of_previous(cell):
            cell.lag_ns = None
            return
        self._follow(cell)
        self._ready.append(cell)
        for stream in cell.streams:
            self._data[stream.place] = self._frames[stream.place]
        if not self._is_aligned:
            return
        lag_ns = cell.end_ns - self._begin_ns
        if cell.lag_ns is not None:
            self._late_ns = lag_ns - cell.lag_ns
            self._passed_ns = max(self._passed_ns, cell.lag_ns)
        cell.lag_ns = lag_ns
        if cell.note(self._number):
            self._compare(cell)
        if len(self._ready) == len(self._cells):
            self._close()

    def _follow(self, cell: LoadCell) -> None:
        """Follow the cycles with the newest sample, which may be the first one of a cycle."""
        gap_ns, self._sample_ns = cell.end_ns - self._sample_ns, cell.end_ns
        if 0 <= gap_ns <= PAUSE_NS:  # else it is the first one, or the clock was set
            cell.gaps_ns.append(gap_ns)
        if not self._is_aligned:
            self._find_begin(cell)
        elif not self._ready or cell in self._ready or cell is self._next or self._is_next(cell):
            self._close()
            if cell is self._next:
                self._next = None
                self._forget_lags()
            elif self._is_misplaced():
                self._next = self._behind
                self._forget_lags()
            self._begin(cell)
        elif gap_ns > self._gap_ns:
            self._gap_ns, self._behind = gap_ns, cell

    def _begin(self, first: LoadCell) -> None:
        """Begin a cycle with the newest sample of a load cell."""
        self._first, self._is_aligned = first, True
        self._number += 1
        begin_ns = first.end_ns - (first.lag_ns or 0)
        self._durations_ns.append(begin_ns - self._begin_ns if self._begin_ns else first.gap_ns())
        self._gaps_ns.append(first.gap_ns())
        self._begin_ns, self._gap_ns, self._passed_ns = begin_ns, 0, 0

    def _align(self, first: LoadCell | None) -> None:
        """Wait for the sample with which a cycle begins; those before it are in none."""
        self._ready.clear()
        self._is_aligned, self._gap_ns, self._next = False, 0, None
        if first is not self._first:
            self._first = first
            self._forget_lags()

    def _forget_lags(self) -> None:
        """Forget when samples follow the begin of a cycle, as cycles begin elsewhere."""
        for cell in self._cells:
            cell.lag_ns = None

    def _find_begin(self, cell: LoadCell) -> None:
        """Begin a cycle with the sample that is waited for, or else with the one behind the largest gap."""
        if cell in self._ready:  # all were received since, or are silent
            is_whole = len(self._ready) == len(self._cells)
            first = max(self._ready, key=LoadCell.gap_ns)
            if first is not cell:
                self._ready = [one for one in self._ready[self._ready.index(first) :] if one is not cell]
                self._begin(first)
                return
            if is_whole:
                self._is_aligned = True
                self._close()
            self._align(first)
        if cell is self._first:
            self._ready.clear()
            self._begin(cell)

    def _is_of_previous(self, cell: LoadCell) -> bool:
        """Whether a sample is of the cycle before, which lacks it: it is earlier than usual in this one."""
        if cell.lag_ns is None or cell.counts.cycles_per_sample > 1.0:
            return False
        return 2 * (self._begin_ns + cell.lag_ns - cell.end_ns) > self._shortest_ns()

    def _is_next(self, cell: LoadCell) -> bool:
        """Whether a sample is not of the open cycle, of which the one of its load cell was lost.

        If none was lost, all are late: then none was received that usually follows.
        """
        if cell.lag_ns is None:
            return False
        late_ns = cell.end_ns - self._begin_ns - cell.lag_ns - self._late_ns
        if late_ns <= 0 or 2 * late_ns <= self._shortest_ns():
            return False
        was_passed = cell.lag_ns < self._passed_ns and cell.counts.cycles_per_sample <= 1.0
        return was_passed or any(stream.samples > 1 for stream in cell.streams)

    def _is_misplaced(self) -> bool:
        """Whether cycles should begin elsewhere: the gap before another sample has been larger in several.

        Cycles that a sender sends at once, after it was put aside, have gaps of no meaning.
        """
        if self._gap_ns <= self._gaps_ns[-1] or not are_larger(self._behind.gaps_ns, self._gaps_ns):
            return False
        period_ns = min((cell.period_ns for cell in self._cells if cell.period_ns), default=0.0)
        return 2 * max(self._durations_ns) > period_ns

    def _shortest_ns(self) -> int:
        """Period of the cycles: the usual one, or if shorter the longest of the newest ones."""
        period_ns = self.period_ns or LONGEST_PERIOD_NS
        return min(max(self._durations_ns, default=period_ns), period_ns)

    def _compare(self, cell: LoadCell) -> None:
        """Estimate the period of the fastest load cell, and how slow another one is."""
        sending = [one.period_ns for one in self._cells if one.is_sending(cell.end_ns)]
        fastest_ns = round(min(*sending, cell.period_ns, LONGEST_PERIOD_NS))
        cell.compare(fastest_ns)
        if self._is_estimated:
            self.period_ns = fastest_ns

    def _close(self) -> None:
        """End the open cycle."""
        ready, self._ready = self._ready, []
        if ready and self._is_aligned:
            self._make(ready, min(cell.begin_ns for cell in ready))

    def _make(self, ready: Sequence[LoadCell], begin_ns: int) -> None:
        """Make a cycle of the newest samples of load cells; of no others there is one."""
        if begin_ns <= self._stamp_ns <= self._frame_ns:  # of a sample that began before the cycle before
            begin_ns = self._stamp_ns + 1
        self._stamp_ns = begin_ns
        strain, status = self._protocol.decode(self._data)
        self.counts.cycles += 1
        for p, cell in enumerate(self._cells):
            if cell in ready:
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
        numbers = [cell.sequence if cell.streams[0].counter else self.counts.cycles for cell in self._cells]
        self._cycles.append(Cycle(begin_ns, strain, status, np.array(numbers).astype(np.uint32)))
