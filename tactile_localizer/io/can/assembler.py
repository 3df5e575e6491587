"""Assembly of frames into cycles: the strain of all phalanges at one time.

A cycle holds what is received within half a period of its first frame. It closes at the end of that time,
when all its frames have been received, or when a load cell sends its next sample. The frames of one sample
of a load cell belong together by its counter; gaps of the counter are lost samples. A phalanx without a
complete sample is ``MISSING`` and its voltages are NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import can
import numpy as np

from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, SATURATED

SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS = 500_000, 1_000_000_000
"""Range of estimated periods, ns: 2 kHz to 1 Hz."""

MAX_LATE = 2
"""Most samples by which a counter is taken as late; further behind, it has advanced or restarted."""

MAX_LOST = 1000
"""Most samples counted as lost at once, 1 s at 1 kHz; a counter further ahead has restarted."""


@dataclass(frozen=True)
class Cycle:
    """Strain of F phalanges in one cycle of the load cells.

    Attributes
    ----------
    stamp_ns : receive time of the first frame, ns
    strain : (C,) V; NaN where missing
    status : (F,) uint8 bits of :mod:`~tactile_localizer.io.status`
    sequence : (F,) uint32, unwrapped counter of the load cell; number of the cycle if it has no counter
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
    jumps : frames whose counter does not continue the previous one; many of them indicate losses or two
        senders with the same identifiers
    restarts : jumps of the counter that are too large for losses
    saturated, faults : samples with that status
    last_ns : receive time of the last frame used, ns; 0 before the first
    """

    samples: int = 0
    missing: int = 0
    drops: int = 0
    jumps: int = 0
    restarts: int = 0
    saturated: int = 0
    faults: int = 0
    last_ns: int = 0


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


@dataclass(slots=True)
class _LoadCell:
    """Newest sample of a load cell.

    Attributes
    ----------
    parts : frames per sample
    span : values of the counter; 0 without a counter
    counter : ``None`` before the first sample
    sequence : unwrapped counter
    cycle : number of its cycle
    began_ns : stamp of its first frame
    sent : its frames; 0 for the first sample, of which some were sent before reception began
    have : bit mask of its received frames
    is_open : whether its cycle is open
    """

    parts: int
    span: int
    counts: PhalanxCounts = field(default_factory=PhalanxCounts)
    counter: int | None = None
    sequence: int = 0
    cycle: int = 0
    began_ns: int = 0
    sent: int = 0
    have: int = 0
    is_open: bool = False


class CycleAssembler:
    """Assembles frames into cycles.

    Parameters
    ----------
    protocol : layout of the frames
    period_s : period of the samples, s; 0: estimated from the time between the samples of each load cell, and
        cycles before the first estimate are discarded
    """

    def __init__(self, protocol: LoadCellProtocol, period_s: float = 0.0) -> None:
        phalanx_of = [message.phalanx for message in protocol.messages]
        spans = {message.phalanx: message.counter_span for message in protocol.messages}
        self._cells = [_LoadCell(phalanx_of.count(p), spans[p]) for p in range(len(protocol.phalanges))]
        self._slots = [
            (self._cells[p], 1 << phalanx_of[:slot].count(p), protocol.bytes_of(slot))
            for slot, p in enumerate(phalanx_of)
        ]
        self.counts = BusCounts([cell.counts for cell in self._cells])
        self._protocol = protocol
        self._is_estimated = not period_s
        self.period_ns = round(period_s * 1e9)  # 0: not estimated yet
        self._data = bytearray(protocol.size)  # of the frames of the open cycle
        self._cycles: list[Cycle] = []  # closed, not yet returned
        self._is_open = False
        self._number = 0  # of the newest cycle
        self._first_ns = 0  # stamp of its first frame
        self._awaited = 0  # its frames not yet received

    def reset(self) -> None:
        """Close the open cycle and forget the counters, as after a pause. Totals and the period are kept."""
        self._close()
        for cell in self._cells:
            cell.counter = None

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
        """Close the open cycle if a period has passed at ``now_ns`` (clock of the frames); returns it.

        That is half a period after the last frame of the cycle, which may have been read late.
        """
        if self.remaining_ns(now_ns) == 0:
            self._close()
        return self.feed([])

    def remaining_ns(self, now_ns: int) -> int | None:
        """Time from ``now_ns`` until the open cycle is flushed, ns; ``None`` if none is open."""
        period_ns = self.period_ns or LONGEST_PERIOD_NS
        elapsed_ns = abs(now_ns - self._first_ns)  # negative after a step of the clock
        return max(0, period_ns - elapsed_ns) if self._is_open else None

    def _take(self, frame: can.Message) -> FrameKind:
        """Use a frame; returns its kind, or the reason why it is not used."""
        kind, slot, counter = self._protocol.classify(frame)
        if kind:
            if kind != FrameKind.ERROR:
                self.counts.misfits[slot] = frame
            return kind
        cell, bit, place = self._slots[slot]
        stamp_ns = int(frame.timestamp * 1e9)
        if self._is_open and self.period_ns and 2 * abs(stamp_ns - self._first_ns) > self.period_ns:
            self._close()
        if not cell.is_open or cell.counter != counter or cell.have & bit:
            kind = self._begin_sample(cell, bit, counter, stamp_ns)
            if kind:
                cell.counts.jumps += 1
                return kind
        cell.have |= bit
        cell.counts.last_ns = stamp_ns
        self._data[place] = frame.data
        self._awaited -= 1
        if not self._awaited:
            self._close()
        return FrameKind.DATA

    def _begin_sample(self, cell: _LoadCell, bit: int, counter: int, stamp_ns: int) -> FrameKind:
        """Begin a sample, in the open cycle or a new one; returns the reason if the frame begins none."""
        advance = 1
        if cell.counter is None:
            advance = (counter - cell.sequence) % (cell.span or 1)
        elif cell.span:
            # The other load cells count the cycles during a silence that is longer than the counter's span.
            earliest = self._number - cell.cycle - min(MAX_LATE, cell.span // 4)
            advance = earliest + (counter - cell.counter - earliest) % cell.span
            if advance <= 0:
                return FrameKind.OUT_OF_ORDER if advance or not cell.have & bit else FrameKind.DUPLICATE
            advance = self._count(cell, advance)
        if cell.counter is not None and advance == 1:
            self._estimate_period(stamp_ns - cell.began_ns)
        if cell.is_open:
            self._close()
        if not self._is_open:
            self._is_open = True
            self._number += 1
            self._first_ns = stamp_ns
            self._awaited = len(self._slots)
        cell.sent = 0 if cell.counter is None else cell.parts
        cell.counter, cell.cycle, cell.began_ns = counter, self._number, stamp_ns
        cell.sequence += advance
        cell.have, cell.is_open = 0, True
        return FrameKind.DATA

    def _count(self, cell: _LoadCell, advance: int) -> int:
        """Count what was lost before a sample; returns the advance of its counter, 1 after a restart."""
        counts = cell.counts
        counts.jumps += advance > 1
        if advance - (self._number - cell.cycle) > MAX_LOST:
            counts.restarts += 1
            return 1
        counts.drops += (advance - 1) * cell.parts + max(0, cell.sent - cell.have.bit_count())
        return advance

    def _estimate_period(self, elapsed_ns: int) -> None:
        """Update the period with the time between two samples of a load cell, one after the other."""
        if not self._is_estimated or elapsed_ns < 0:
            return
        # A delayed sample counts as at most twice the period.
        elapsed_ns = min(elapsed_ns, 2 * self.period_ns or LONGEST_PERIOD_NS)
        change_ns = (elapsed_ns - self.period_ns) // 8 if self.period_ns else elapsed_ns
        self.period_ns = max(self.period_ns + change_ns, SHORTEST_PERIOD_NS)

    def _close(self) -> None:
        if not self._is_open:
            return
        self._is_open = False
        if self.period_ns:
            self._cycles.append(self._cycle())
        for cell in self._cells:
            cell.is_open = False

    def _cycle(self) -> Cycle:
        """Decode the open cycle."""
        strain, status = self._protocol.decode(self._data)
        for p, cell in enumerate(self._cells):
            if cell.is_open and cell.have == (1 << cell.parts) - 1:
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
        sequence = np.array([cell.sequence if cell.span else self._number for cell in self._cells])
        return Cycle(self._first_ns, strain, status, sequence.astype(np.uint32))
