"""Frames to cycles: what all phalanges felt at one time, with what is missing marked and counted.

A cycle is one sample of every load cell. Its first frame opens it; it closes

- when all its frames are there,
- when a load cell sends a frame of its next sample, or
- when the stated wait has passed since its first frame.

A phalanx of which a frame is missing then is marked so, and its voltages are NaN. Frames are never
mixed with those of another cycle: a rolling counter tells which sample of its load cell a frame belongs
to, and, since all load cells make one sample a cycle, which cycle. A frame that comes after its cycle
has closed is counted and dropped. A load cell that has been in no cycle for a while, because it was
silent, started anew, or slipped by a cycle since its clock drifts, is taken as it comes.

Where the DBC has no counter only time tells cycles apart: a frame later than half the cycle's period,
which is learned from complete cycles, is of the next one.

The first cycles are withheld until it is sure where a cycle begins (:mod:`~tactile_localizer.io.can_phase`).
"""

from __future__ import annotations

from array import array

import numpy as np

from tactile_localizer.io.can_cycle import Counts, Cycle, PhalanxCounts
from tactile_localizer.io.can_frames import FrameBatch
from tactile_localizer.io.can_phase import CyclePhase
from tactile_localizer.io.can_protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, SATURATED

REACH = 8
"""Cycles over which a counter tells which cycle a frame belongs to; later frames are taken as they come."""
BEHIND = 2
"""Samples that a frame may be behind the newest of its load cell, or cycles behind the open one, to count as
out of order; further behind it is rather of a cycle after many that were lost."""


class _LoadCell:
    """What is known of one load cell between frames."""

    __slots__ = (
        *("behind", "complete", "counter", "counts", "cycle", "flags"),
        *("have", "parts", "reach", "sequence", "span"),
    )

    def __init__(self, parts: int, counter_bits: int, counts: PhalanxCounts) -> None:
        self.parts = parts  # frames a sample
        self.complete = (1 << parts) - 1
        self.span = 1 << counter_bits if counter_bits else 0  # counter values, 0: no counter
        self.behind = min(BEHIND, self.span // 4)
        self.reach = min(REACH, self.span // 2 + 1)
        self.counts = counts
        self.counter: int | None = None  # of the newest sample
        self.cycle = 0  # number of the cycle that the newest sample is in
        self.have = 0  # bits of its frames that are there
        self.flags = 0
        self.sequence = 0


class CycleAssembler:
    """Makes cycles of frames.

    Parameters
    ----------
    protocol : the frames' layout
    wait_s : how long a cycle waits for its frames, s
    """

    def __init__(self, protocol: LoadCellProtocol, wait_s: float) -> None:
        layout = protocol.layout
        phalanx_of = layout.phalanx.tolist()
        self._protocol = protocol
        self._wait_ns = round(wait_s * 1e9)
        self._window_ns = self._wait_ns  # how long a cycle is open
        self.counts = Counts(
            frames=[0] * len(FrameKind), phalanges=[PhalanxCounts() for _ in protocol.phalanges]
        )
        self._cells = [
            _LoadCell(phalanx_of.count(p), int(layout.counter_bits[phalanx_of.index(p)]), counts)
            for p, counts in enumerate(self.counts.phalanges)
        ]
        self._cell_of = [self._cells[p] for p in phalanx_of]
        self._bit_of = [1 << phalanx_of[:slot].count(p) for slot, p in enumerate(phalanx_of)]
        self._no_counter = any(cell.span == 0 for cell in self._cells)
        self._channel = layout.channel
        self._channels = protocol.channels
        self._cycles: list[Cycle] = []  # closed, not yet handed out
        self._voltage = np.empty((0, layout.channel.shape[1]))  # of the frames being fed
        self._strain = np.empty(0)
        self._period_ns = 0
        self._previous_ns = 0
        self._cycle = 0
        self._phase = CyclePhase()
        self.reset()

    def reset(self) -> None:
        """Forget the open cycle and the counters' values, as after a pause of unknown length. Totals stay."""
        self._open = False
        self._first_ns = 0
        self._last_ns: int | None = None  # of the newest frame used
        self._awaited = 0  # frames that the open cycle still lacks
        self._rows: list[int] = []  # the open cycle's frames in the batch
        self._slots: list[int] = []
        self._phase.forget()
        self._forget_counters()

    def _forget_counters(self) -> None:
        for cell in self._cells:
            cell.counter = None
            cell.have = 0

    def feed(self, frames: FrameBatch) -> list[Cycle]:
        """Cycles that ``frames``, in the order of their arrival, complete or close."""
        decoded = self._protocol.decode(frames)
        totals = self.counts.frames
        for kind, count in enumerate(np.bincount(decoded.kind, minlength=len(totals)).tolist()):
            totals[kind] += count
        rows = np.flatnonzero(decoded.kind == FrameKind.DATA)
        self._voltage = decoded.voltage
        flags = decoded.fault[rows] * FAULT | decoded.saturated[rows] * SATURATED
        for row, slot, counter, flag, stamp_ns in zip(
            rows.tolist(),
            decoded.slot[rows].tolist(),
            decoded.counter[rows].tolist(),
            flags.tolist(),
            frames.stamp_ns[rows].tolist(),
            strict=True,
        ):
            cell, bit = self._cell_of[slot], self._bit_of[slot]
            if self._open and abs(stamp_ns - self._first_ns) > self._window_ns:
                self._close()
            goes_on = cell.counter == counter and cell.have and not cell.have & bit
            if not (goes_on and self._open and cell.cycle == self._cycle):
                kind = self._begin_sample(cell, bit, counter, stamp_ns)
                if kind != FrameKind.DATA:
                    totals[FrameKind.DATA] -= 1
                    totals[kind] += 1
                    continue
            cell.have |= bit
            cell.flags |= flag
            cell.counts.last_ns = self._last_ns = stamp_ns
            self._rows.append(row)
            self._slots.append(slot)
            self._awaited -= 1
            if not self._awaited:
                self._close()
        self._keep()
        return self.flush(int(frames.stamp_ns[-1])) if len(frames) else self._take()

    def flush(self, now_ns: int) -> list[Cycle]:
        """The open cycle, where its wait is over at ``now_ns``, by the clock of the frames' stamps."""
        if self._open and abs(now_ns - self._first_ns) > self._window_ns:
            self._close()
        return self._take()

    def remaining_ns(self, now_ns: int) -> int | None:
        """How long from ``now_ns`` the open cycle still waits, ns; ``None`` where none is open."""
        return max(0, self._first_ns + self._window_ns - now_ns) if self._open else None

    def _begin_sample(self, cell: _LoadCell, bit: int, counter: int, stamp_ns: int) -> FrameKind:
        """Begin a load cell's next sample, closing and opening cycles as needed; or say why there is none."""
        if cell.span == 0 or cell.counter is None:
            self._join(cell, 0, stamp_ns, stranger=cell.span > 0)
            cell.sequence = _next(cell.sequence, counter, cell.span) if cell.span else self._cycle
        else:
            step = (counter - cell.counter) % cell.span or cell.span  # samples since the newest one
            if abs(stamp_ns - cell.counts.last_ns) <= self._wait_ns:
                if step == cell.span:
                    return FrameKind.DUPLICATE if cell.have & bit else FrameKind.OUT_OF_ORDER
                if step >= cell.span - cell.behind:
                    return FrameKind.OUT_OF_ORDER
            in_open = cell.have and cell.cycle == self._cycle
            expected = self._cycle + (in_open or not self._open) - cell.cycle
            ahead = _nearest(step - expected, cell.span)  # cycles that it is beyond the open, or next, one
            trusted = -cell.behind <= ahead < cell.reach > expected  # else it is taken as it comes
            if trusted and ahead < 0:
                return FrameKind.OUT_OF_ORDER
            self._count_lost(cell, step, expected + ahead)
            self._join(cell, ahead if trusted else 0, stamp_ns, stranger=not trusted)
        cell.counter = counter
        cell.cycle = self._cycle
        cell.have = cell.flags = 0
        return FrameKind.DATA

    def _join(self, cell: _LoadCell, ahead: int, stamp_ns: int, *, stranger: bool) -> None:
        """Make the cycle of a load cell's sample the open one: ``ahead`` of the open, or else next, one.

        A ``stranger`` was in no cycle lately, so that its counter does not tell which one it is of.
        """
        if self._open and cell.have and cell.cycle == self._cycle:
            self._close()
        if self._open and ahead > 0:
            self._close()
            ahead -= 1
        pause_ns = 0 if self._last_ns is None else stamp_ns - self._last_ns
        if self._open and stranger and not self._phase.admits(pause_ns):
            self._close()
        if self._open and not self._phase.joins(pause_ns):
            self._close()
            self._forget_counters()
        if not self._open:
            self._open = True
            self._cycle += 1 + ahead
            self._first_ns = stamp_ns
            self._awaited = len(self._cell_of)
            self._strain = np.full(self._channels.size + 1, np.nan)  # the last is for what has no channel
            self._phase.begin(pause_ns)

    @staticmethod
    def _count_lost(cell: _LoadCell, step: int, advance: int) -> None:
        if advance < 1:
            # A wide counter that goes back has started anew; a narrow one has gone round.
            advance = 1 if cell.span >= 256 else step
        cell.sequence += advance
        cell.counts.gaps += advance - 1
        cell.counts.drops += advance * cell.parts - cell.have.bit_count()

    def _close(self) -> None:
        self._keep()
        self._open = False
        self._learn_period(incomplete=self._awaited > 0)
        self._phase.end()
        if self._phase.sure:
            self._cycles.append(self._made())
        else:
            self.counts.withheld += 1

    def _made(self) -> Cycle:
        status, sequence = array("B"), array("I")
        for p, cell in enumerate(self._cells):
            here = cell.cycle == self._cycle and cell.have != 0
            flags = cell.flags if here else 0
            if here and cell.have == cell.complete:
                cell.counts.samples += 1
            else:
                flags |= MISSING
                cell.counts.missing += 1
                self._strain[self._channels.slices[p]] = np.nan
            if flags:
                cell.counts.saturated += flags & SATURATED != 0
                cell.counts.faults += flags & FAULT != 0
            status.append(flags)
            sequence.append(cell.sequence & 0xFFFFFFFF)
        self.counts.cycles += 1
        self.counts.incomplete += self._awaited > 0
        return Cycle(self._first_ns, self._strain[:-1], status, sequence)

    def _learn_period(self, incomplete: bool) -> None:
        elapsed = self._first_ns - self._previous_ns
        if not incomplete and self._previous_ns and elapsed > 0:
            if self._period_ns:
                elapsed = min(elapsed, 2 * self._period_ns)  # a cycle may have been lost between
                self._period_ns += (elapsed - self._period_ns) // 8
            else:
                self._period_ns = elapsed
            if self._no_counter:
                self._window_ns = min(self._wait_ns, self._period_ns // 2)
        self._previous_ns = 0 if incomplete else self._first_ns

    def _keep(self) -> None:
        # Voltages of the open cycle's frames leave the batch's array: when it closes, or the batch ends.
        if self._rows:
            self._strain[self._channel[self._slots]] = self._voltage[self._rows]
            self._rows, self._slots = [], []

    def _take(self) -> list[Cycle]:
        cycles, self._cycles = self._cycles, []
        return cycles


def _next(sequence: int, counter: int, span: int) -> int:
    """The first number from ``sequence`` on whose low bits are ``counter``."""
    return sequence + (counter - sequence) % span


def _nearest(difference: int, span: int) -> int:
    """``difference`` modulo ``span``, between ``-span / 2`` (not included) and ``span / 2``."""
    return (difference + (span - 1) // 2) % span - (span - 1) // 2
