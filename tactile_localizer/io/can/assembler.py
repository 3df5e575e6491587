"""Assembly of frames into cycles: the strain of all phalanges at one time.

A cycle is one sample of every load cell. It opens with its first frame, and closes

- when all its frames have been received,
- when a load cell sends a frame of a later cycle, or
- when the timeout has passed since its first frame.

If a frame of a phalanx is missing then, the phalanx is marked ``MISSING`` and its voltages are NaN. Frames
of different cycles are never mixed: the load cell's counter determines the cycle of a frame
(:mod:`~tactile_localizer.io.can.alignment`). While that is uncertain, in the first cycles or after a pause
or a restart of the load cell, the phalanx is ``MISSING`` as well. A frame that is received after its cycle
has closed is counted and dropped.

Load cells without a counter in the DBC are assigned by time: a frame later than half the period, which is
estimated from complete cycles, belongs to the next cycle.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import NamedTuple

import can
import numpy as np

from tactile_localizer.io.can.alignment import (
    CERTAIN_LEAD,
    MAX_ABSENCE,
    SHORTEST_PAUSE_NS,
    Alignment,
    LoadCellCounter,
)
from tactile_localizer.io.can.breaks import CounterBreaks
from tactile_localizer.io.can.cycle import Counts, Cycle, PhalanxCounts
from tactile_localizer.io.can.frames import received_ns
from tactile_localizer.io.can.protocol import Decoded, FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, SATURATED

MAX_LOST = 1000
"""Most cycles counted as lost at once, 1 s at 1 kHz; a counter further ahead has restarted."""

_LATE = -1
_UNALIGNED = -2
"""In place of a cycle's number: the cycle has closed already, or is uncertain."""


class _LoadCell:
    """State of one load cell between frames."""

    __slots__ = (
        *("alignment", "at", "breaks", "complete", "counter", "counts", "cycle", "flags", "have"),
        *("began_ns", "begun", "doubled", "is_first", "opened", "parts", "published", "sequence"),
    )

    def __init__(self, parts: int, alignment: LoadCellCounter | None, counts: PhalanxCounts) -> None:
        self.parts = parts  # frames per sample
        self.complete = (1 << parts) - 1
        self.alignment = alignment  # None: no counter
        self.counts = counts
        self.breaks = CounterBreaks(counts)
        self.counter: int | None = None  # of the newest sample
        self.cycle = _UNALIGNED  # number of the newest sample's cycle, or _LATE, or _UNALIGNED
        self.at = 0  # cycles opened when the newest sample began, including this one
        self.began_ns = 0  # stamp of the first frame of the newest sample
        self.begun = 0  # samples of all load cells when the newest one began
        self.opened = 0  # cycles opened by then
        self.have = 0  # bit mask of the received frames of the newest sample
        self.is_first = True  # its first sample since reception began
        self.doubled = False  # a frame was repeated in an incomplete sample, so it may be of another one
        self.flags = 0
        self.sequence = 0  # unwrapped counter
        self.published = 0  # sequence of the newest sample; `sequence` is counted on before its cycle closes


class _Jump(NamedTuple):
    """Cycles skipped by one load cell and not yet confirmed by another one."""

    cell: _LoadCell
    cycles: int
    sequence: int  # before
    totals: tuple[int, int]  # its gaps and drops before


class CycleAssembler:
    """Assembles frames into cycles.

    Parameters
    ----------
    protocol : layout of the frames
    wait_s : timeout of a cycle after its first frame, s
    """

    def __init__(self, protocol: LoadCellProtocol, wait_s: float) -> None:
        phalanx_of = [message.phalanx for message in protocol.messages]
        bits = [protocol.messages[phalanx_of.index(p)].counter_bits for p in range(len(protocol.phalanges))]
        self._protocol = protocol
        self._wait_ns = round(wait_s * 1e9)
        self._window_ns = self._wait_ns  # time for which a cycle stays open
        self.counts = Counts(
            frames=[0] * len(FrameKind), phalanges=[PhalanxCounts() for _ in protocol.phalanges]
        )
        self._alignment = Alignment(bits)
        self._cells = [
            _LoadCell(phalanx_of.count(p), self._alignment.counters[p], counts)
            for p, counts in enumerate(self.counts.phalanges)
        ]
        self._cell_of = [self._cells[p] for p in phalanx_of]
        self._bit_of = [1 << phalanx_of[:slot].count(p) for slot, p in enumerate(phalanx_of)]
        self._columns = [
            np.array([gauge.column for gauge in message.gauges], int) for message in protocol.messages
        ]
        self._channels = protocol.channels
        self._cycles: list[Cycle] = []  # closed, not yet returned
        self._strain = np.empty(0)
        self._period_ns = 0
        self._periods = 0  # number of measured periods
        self._cycle = 0  # number of the newest cycle
        self._expired = 0  # number of the newest cycle that was closed by the timeout
        self._open = False
        self._opened = 0  # cycles opened
        self._begun = 0  # samples of all load cells that have begun
        self.reset()

    def reset(self) -> None:
        """Close the open cycle and forget the counters, as after a pause. Totals are kept."""
        self._close()
        self._first: _LoadCell | None = None  # load cell that opened the cycle
        self._first_ns = 0
        self._last_ns: int | None = None  # of the newest frame of a load cell
        self._jump: _Jump | None = None
        self._awaited = 0  # missing frames of the open cycle
        self._alignment.reset()
        for cell in self._cells:
            cell.counter, cell.is_first = None, True
            cell.breaks.confirm()
            cell.have = 0

    @property
    def aligned(self) -> list[bool]:
        """Whether the assignment of samples to cycles is certain, for each phalanx."""
        return [
            self._periods >= CERTAIN_LEAD if cell.alignment is None else cell.alignment.certain
            for cell in self._cells
        ]

    def feed(self, frames: Sequence[can.Message]) -> list[Cycle]:
        """Process frames in order of reception; returns the cycles that they complete or close."""
        for frame in frames:
            decoded = self._protocol.decode(frame)
            kind = decoded.kind
            if kind == FrameKind.DATA:
                kind = self._take(decoded, received_ns(frame))
            self.counts.frames[kind] += 1
        return self.flush(received_ns(frames[-1])) if frames else self._closed_cycles()

    def flush(self, now_ns: int) -> list[Cycle]:
        """Close the open cycle if it has timed out at ``now_ns`` (clock of the frames); returns it."""
        self._expire(now_ns)
        return self._closed_cycles()

    def remaining_ns(self, now_ns: int) -> int | None:
        """Time from ``now_ns`` to the timeout of the open cycle, ns; ``None`` if none is open."""
        return max(0, self._first_ns + self._window_ns - now_ns) if self._open else None

    def _take(self, decoded: Decoded, stamp_ns: int) -> FrameKind:
        """Use a frame of a load cell; returns ``DATA``, or the reason why it is not used."""
        cell, bit = self._cell_of[decoded.slot], self._bit_of[decoded.slot]
        self._expire(stamp_ns)
        kind = self._take_frame(cell, bit, decoded.counter, stamp_ns)
        self._last_ns = stamp_ns
        if kind != FrameKind.DATA:
            return kind
        cell.have |= bit
        cell.counts.last_ns = stamp_ns
        if cell.cycle != _UNALIGNED:
            cell.flags |= decoded.fault * FAULT | decoded.saturated * SATURATED
            self._strain[self._columns[decoded.slot]] = decoded.voltage
            self._awaited -= 1
            if not self._awaited:
                self._close()
        return kind

    def _take_frame(self, cell: _LoadCell, bit: int, counter: int, stamp_ns: int) -> FrameKind:
        """Assign a frame to its sample and cycle; returns ``DATA``, or the reason why it is not used."""
        if cell.counter == counter and cell.have and not cell.have & bit and self._follows(cell, 1):
            if cell.cycle == _UNALIGNED or (self._open and cell.cycle == self._cycle):
                if cell.alignment is not None:
                    cell.doubled |= self._may_wrap(cell.alignment, stamp_ns - cell.began_ns)
                return FrameKind.DATA
            if cell.alignment is not None:
                return FrameKind.OUT_OF_ORDER
        if cell.alignment is None:
            return self._begin_by_time(cell, counter, stamp_ns)
        return self._begin_sample(cell, cell.alignment, bit, counter, stamp_ns)

    def _follows(self, cell: _LoadCell, cycles: int) -> bool:
        """Whether a load cell's newest sample began at most ``cycles`` samples of each load cell ago."""
        return self._begun - cell.begun <= cycles * len(self._cells)

    def _begin_by_time(self, cell: _LoadCell, counter: int, stamp_ns: int) -> FrameKind:
        """Begin a sample of a load cell without a counter."""
        self._learn_period(cell, stamp_ns)
        cell.began_ns = stamp_ns
        if self._open and cell.have and cell.cycle == self._cycle:
            self._close()
        cell.sequence = self._cycle + (not self._open)
        if self._open:
            self._put(cell, counter, self._cycle)
        else:
            self._open_cycle(cell, counter, self._cycle + 1, stamp_ns)
        return FrameKind.DATA

    def _begin_sample(
        self, cell: _LoadCell, alignment: LoadCellCounter, bit: int, counter: int, stamp_ns: int
    ) -> FrameKind:
        """Begin a sample, closing and opening cycles as needed; returns ``DATA``, or the reason why not."""
        sequence, totals = cell.sequence, cell.breaks.totals
        kind = self._count(cell, alignment, bit, counter, stamp_ns)
        if kind != FrameKind.DATA:
            return kind
        cell.began_ns = stamp_ns
        cycle = self._cycle_of(cell, alignment, counter, stamp_ns)
        joins = self._open and cycle == self._cycle != cell.cycle
        if cycle is not None and cycle <= self._cycle and not joins:
            if cycle != self._expired:  # only a wrong offset makes a sample late for a complete cycle
                alignment.doubt()
            self._put(cell, counter, _LATE)
            cell.have = bit
            return FrameKind.OUT_OF_ORDER
        alone = self._alignment.alone(alignment)
        after_ns = stamp_ns - self._first_ns if joins else 0
        late = 0 < self._period_ns < 2 * after_ns
        if (
            cycle is None
            or not (alone or alignment.admits(first=not joins, late=late))
            or self._may_wrap(alignment, after_ns)
        ):
            self._put(cell, counter, _UNALIGNED)
            cell.counts.unaligned += 1
            return FrameKind.DATA
        if joins:
            if self._first is not None and self._first.alignment is not None:
                self._first.alignment.placed(first=True)
                alignment.placed(first=False)
            self._put(cell, counter, cycle)
            return FrameKind.DATA
        if cycle > self._cycle + 1 and not alone:
            self._jump = _Jump(cell, cycle - self._cycle, sequence, totals)
        self._close()
        self._open_cycle(cell, counter, cycle, stamp_ns)
        return FrameKind.DATA

    def _may_wrap(self, alignment: LoadCellCounter, elapsed_ns: int) -> bool:
        """Whether a counter that has the same value after this time may be a whole span further on."""
        return 0 < alignment.span * self._period_ns < 2 * elapsed_ns

    def _count(
        self, cell: _LoadCell, alignment: LoadCellCounter, bit: int, counter: int, stamp_ns: int
    ) -> FrameKind:
        """Count losses since the load cell's newest sample; returns the reason if the frame begins none."""
        if cell.counter is None:
            cell.sequence += (counter - cell.sequence) % alignment.span
            return FrameKind.DATA
        # Frames missing from a load cell's first sample were sent before reception began.
        is_first, cell.is_first = cell.is_first, False
        step = (counter - cell.counter) % alignment.span or alignment.span
        if step == 1:
            self._learn_period(cell, stamp_ns)
        else:
            alignment.broken()
        alternated = cell.breaks.alternates(cell.counter, counter, alignment.span)
        if alternated and cell.breaks.two_senders:
            cell.breaks.begin(cell.counter, counter, alignment.span, alternated=True)
            cell.counts.interleaved += 1
            return FrameKind.DATA
        if self._follows(cell, 2) and abs(stamp_ns - cell.counts.last_ns) <= self._wait_ns:
            step_back = alignment.span - step
            if step_back <= alignment.max_lateness:
                if alternated:
                    cell.breaks.unused(counter)
                cell.doubled |= cell.have != cell.complete
                cell.counts.interleaved += 1
                return FrameKind.OUT_OF_ORDER if step_back or not cell.have & bit else FrameKind.DUPLICATE
        cell.breaks.begin(cell.counter, counter, alignment.span, alternated=alternated)
        passed = self._opened - cell.at  # cycles since its newest sample; their numbers may have jumped
        least = max(1, passed - alignment.span // 2)
        advance = least + (step - least) % alignment.span
        if advance - passed > MAX_LOST:
            advance = max(1, passed)
            alignment.forget()
        used = cell.parts if is_first else 0 if cell.cycle == _LATE else cell.have.bit_count()
        cell.sequence += advance
        cell.breaks.skip(advance - 1, advance * cell.parts - used)
        return FrameKind.DATA

    def _cycle_of(
        self, cell: _LoadCell, alignment: LoadCellCounter, counter: int, stamp_ns: int
    ) -> int | None:
        """Number of the cycle of a sample that begins; ``None`` if it is uncertain."""
        if cell.breaks.two_senders:
            alignment.forget()
            return None
        if not alignment.certain:
            cell.opened = self._opened
        elif self._opened - cell.opened > MAX_ABSENCE:
            alignment.broken()
        latest = 0 if self._alignment.alone(alignment) else alignment.max_lateness
        in_open = self._open and cell.cycle == self._cycle
        earliest = self._cycle + (in_open or not self._open) - latest
        pause_ns = 0 if self._last_ns is None else stamp_ns - self._last_ns
        self._alignment.begin(alignment, counter, pause_ns, earliest)
        if not alignment.certain:
            return None
        cycle = alignment.cycle(counter, earliest)
        if self._jump is not None and self._jump.cell is not cell:
            jump, self._jump = self._jump, None
            ahead = cycle - self._cycle
            if ahead not in (0, 1) and (ahead + jump.cycles) % alignment.span in (0, 1):
                self._undo(jump)
                cycle = alignment.cycle(counter, self._cycle - alignment.max_lateness)
        return cycle

    def _put(self, cell: _LoadCell, counter: int, cycle: int) -> None:
        self._begun += 1
        cell.begun = self._begun
        cell.counter = counter
        cell.published = cell.sequence
        cell.cycle = cycle
        cell.at = self._opened
        cell.have = cell.flags = 0
        cell.doubled = False
        if cycle >= 0:
            cell.opened = self._opened

    def _open_cycle(self, cell: _LoadCell, counter: int, cycle: int, stamp_ns: int) -> None:
        self._open = True
        self._opened += 1
        self._cycle = cycle
        self._first = cell
        self._first_ns = stamp_ns
        self._awaited = len(self._cell_of)
        self._strain = np.full(self._channels.size, np.nan)
        self._put(cell, counter, cycle)

    def _undo(self, jump: _Jump) -> None:
        """Revert cycles that one load cell skipped and another did not: the first one has restarted."""
        cell = jump.cell
        if self._open and cell.cycle == self._cycle:
            self._open = False
        if cell.cycle != _UNALIGNED:
            cell.cycle = _UNALIGNED
            cell.counts.unaligned += 1
        cell.sequence = cell.published = jump.sequence
        cell.breaks.restore(jump.totals)
        self._cycle -= jump.cycles
        if cell.alignment is not None:
            cell.alignment.forget()
        self._alignment.revise()

    def _expire(self, now_ns: int) -> None:
        if self._open and abs(now_ns - self._first_ns) > self._window_ns:
            self._expired = self._cycle
            self._close()

    def _close(self) -> None:
        if not self._open:
            return
        self._open = False
        incomplete = self._awaited > 0
        status, sequence = array("B"), array("I")
        for p, (cell, aligned) in enumerate(zip(self._cells, self.aligned, strict=True)):
            here = cell.cycle == self._cycle and cell.have != 0
            flags = cell.flags if here else 0
            if here and cell.have == cell.complete and aligned and not cell.doubled:
                cell.counts.samples += 1
            else:
                flags |= MISSING
                cell.counts.missing += 1
                self._strain[self._channels.slices[p]] = np.nan
            if flags:
                cell.counts.saturated += flags & SATURATED != 0
                cell.counts.faults += flags & FAULT != 0
            status.append(flags)
            sequence.append(cell.published & 0xFFFFFFFF)
        self.counts.cycles += 1
        self.counts.incomplete += incomplete
        self._cycles.append(Cycle(self._first_ns, self._strain, status, sequence))

    def _learn_period(self, cell: _LoadCell, stamp_ns: int) -> None:
        """Update the period with the time between two samples of a load cell, one after the other."""
        elapsed = stamp_ns - cell.began_ns
        if cell.began_ns and elapsed > SHORTEST_PAUSE_NS:
            if self._period_ns:
                elapsed = min(elapsed, 2 * self._period_ns)  # limits the effect of lost or delayed samples
                self._period_ns += (elapsed - self._period_ns) // 8
            else:
                self._period_ns = elapsed
            self._periods += 1
            if cell.alignment is None:
                self._window_ns = min(self._wait_ns, self._period_ns // 2)

    def _closed_cycles(self) -> list[Cycle]:
        cycles, self._cycles = self._cycles, []
        return cycles
