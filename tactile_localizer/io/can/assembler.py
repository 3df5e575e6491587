"""Assembly of frames into cycles: the strain of all phalanges at one time.

A cycle begins where :mod:`~tactile_localizer.io.can.cut` says. It closes when all its frames have been
received, when the next one begins, or after a silence. A phalanx without a complete sample is ``MISSING`` and
its voltages are NaN.

Counters do not cut cycles. They count losses, and reveal frames of one load cell that belong to two samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import can
import numpy as np

from tactile_localizer.io.can.counter import MAX_LATE, RollingCounter
from tactile_localizer.io.can.cut import LONGEST_PERIOD_NS, PAUSE_NS, CycleCut, Pace
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, SATURATED

FLUSHED = 3
"""Number of periods of silence after which an open cycle is closed."""

CONFIRMATIONS = 8
"""Cycles in a row with frames of different samples after which the counters of two messages are separate."""


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
    drops : frames sent that are in no cycle, according to the counter; those before it is known where cycles
        begin are not lost
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
    pace : times of the frames
    sequence : number of the sample
    value, samples : value of the counter of that frame, and samples by which it is ahead of the one before
    lead : usual difference of its counter from that of the load cell's first message; ``None``: unknown
    """

    cell: _LoadCell = field(repr=False)
    place: slice
    counter: RollingCounter | None
    pace: Pace
    sequence: int = 0
    value: int = 0
    samples: int = 1
    lead: int | None = None


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

    def forget(self) -> None:
        """Forget how far apart the counters are, unless they were seen to be a common one."""
        for stream in () if self.is_common else self.streams:
            stream.lead = None

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
        load cell
    """

    def __init__(self, protocol: LoadCellProtocol, period_s: float = 0.0) -> None:
        self._cells = [_LoadCell() for _ in protocol.phalanges]
        self._cut = CycleCut(len(protocol.messages), round(period_s * 1e9))
        self._streams = []
        for slot, (message, pace) in enumerate(zip(protocol.messages, self._cut.paces, strict=True)):
            cell = self._cells[message.phalanx]
            counter = RollingCounter(len(message.counter_values)) if message.counter else None
            cell.streams.append(_Stream(cell, protocol.bytes_of(slot), counter, pace))
            self._streams.append(cell.streams[-1])
        self._paired = [cell for cell in self._cells if len(cell.streams) > 1]
        self.counts = BusCounts([cell.counts for cell in self._cells])
        self._protocol = protocol
        self._data = bytearray(protocol.size)  # of the frames of the open cycle
        self._cycles: list[Cycle] = []  # closed, not yet returned
        self._received: set[_Stream] = set()  # those with a frame in the open cycle; none is open without any
        self._first_ns = 0  # stamp of its first frame
        self._moves = 0  # of the cut, after which other frames are in one cycle
        self._torn: list[_LoadCell] = []  # load cells whose frames in it are of different samples

    @property
    def period_ns(self) -> int:
        """Period of the cycles, ns; 0: not estimated yet."""
        return self._cut.period_ns

    def reset(self) -> None:
        """Close the open cycle and forget the counters, as after a pause. Totals and the period are kept."""
        self._close()
        self._cut.restart()
        for stream in self._streams:
            stream.pace.last_ns = 0
            if stream.counter is not None:
                stream.counter.newest = None

    def has_received(self, slot: int) -> bool:
        """Whether frames of a message were received since the last pause."""
        return bool(self._streams[slot].pace.last_ns)

    def feed(self, frames: Sequence[can.Message], oldest_ns: int = 0) -> list[Cycle]:
        """Process frames in order of reception; returns the cycles that they complete or close.

        Frames stamped before ``oldest_ns`` are discarded as late, and close the open cycle: what it lacks is
        late, too.
        """
        for frame in frames:
            if frame.timestamp * 1e9 < oldest_ns:
                self._close()
                self.counts.frames[FrameKind.LATE] += 1
            else:
                self.counts.frames[self._take(frame)] += 1
        cycles, self._cycles = self._cycles, []
        return cycles

    def flush(self, now_ns: int) -> list[Cycle]:
        """Close the open cycle if no frame was received for long by ``now_ns``; returns it.

        ``now_ns`` is of the clock of the frames. The last frames may be delayed, or read late.
        """
        if self.remaining_ns(now_ns) == 0:
            self._close()
            self._cut.restart()
        return self.feed([])

    def remaining_ns(self, now_ns: int) -> int | None:
        """Time from ``now_ns`` until the open cycle is flushed, ns; ``None`` if none is open."""
        if not self._received:
            return None
        silence_ns = FLUSHED * (self.period_ns or LONGEST_PERIOD_NS)
        remaining_ns = self._cut.last_ns + silence_ns - now_ns
        return remaining_ns if 0 < remaining_ns <= 2 * silence_ns else 0  # else the clock was set back

    def _take(self, frame: can.Message) -> FrameKind:
        """Use a frame; returns its kind, or the reason why it is not used."""
        kind, slot, value = self._protocol.classify(frame)
        if kind:
            if kind != FrameKind.ERROR:
                self.counts.misfits[slot] = frame
            return kind
        stream = self._streams[slot]
        stamp_ns = int(frame.timestamp * 1e9)
        if abs(stamp_ns - self._cut.last_ns) > PAUSE_NS:
            self.reset()
        samples, counter = 1, stream.counter
        if counter is not None:
            has_wrapped = self._cut.number - stream.pace.cycle >= counter.span  # possibly
            if has_wrapped or not counter.follows(value):
                samples = self._advance(stream, counter, value, stamp_ns)
                if samples <= 0:
                    return FrameKind.OUT_OF_ORDER if samples else FrameKind.DUPLICATE
        stream.sequence += samples
        stream.cell.counts.last_ns = stamp_ns
        if self._cut.take_into_previous(stream.pace, stamp_ns):
            stream.cell.counts.drops += self._cut.is_known and counter is not None
            return FrameKind.OUT_OF_ORDER
        self._place(stream, frame, stamp_ns, value, samples)
        return FrameKind.DATA

    def _advance(self, stream: _Stream, counter: RollingCounter, value: int, stamp_ns: int) -> int:
        """Samples by which a frame is ahead of the newest of its message; counts those between as lost."""
        if counter.newest is None:
            counter.advance(value, 1.0, 1.0)
            stream.sequence += (value - stream.sequence) % counter.span - 1
            return 1
        counts, jumps, pace = stream.cell.counts, counter.jumps, stream.pace
        cycles = self._cut.cycles_since(pace, stamp_ns) / (pace.cycles_per_sample or 1.0)
        elapsed_ns = stamp_ns - pace.last_ns
        periods = elapsed_ns / (pace.period_ns or self.period_ns or elapsed_ns or 1)
        # While the others send, their cycles are more exact than the time.
        samples = counter.advance(value, cycles if cycles > 1 else periods, max(periods, cycles))
        counts.drops += max(0, samples - 1)
        counts.jumps += counter.jumps - jumps
        counts.counter = counter.problem
        return samples

    def _place(self, stream: _Stream, frame: can.Message, stamp_ns: int, value: int, samples: int) -> None:
        """Use a frame in the open cycle, or in a new one."""
        is_again, pace = stream in self._received, stream.pace
        if is_again and stream.cell in self._torn and not self._cut.cycles_since(pace, stamp_ns):
            is_again = False  # the frame before was late
            self.counts.frames[FrameKind.DATA] -= 1
            self.counts.frames[FrameKind.OUT_OF_ORDER] += 1
            stream.cell.counts.drops += 1
        if self._cut.take(pace, stamp_ns, samples, is_again or not self._received):
            self._close()
            self._first_ns = stamp_ns
        if not self._cut.is_aligned:
            stream.cell.counts.drops += self._cut.is_known and stream.counter is not None
            return
        if self._moves < self._cut.moves:
            self._moves = self._cut.moves
            for cell in self._paired:
                cell.forget()
        stream.value, stream.samples = value, samples
        self._data[stream.place] = frame.data
        self._received.add(stream)
        if len(self._received) == len(self._streams):
            self._torn = [cell for cell in self._paired if cell.leads()]
            if not self._torn:  # else the right frames can still come
                self._close()

    def _close(self) -> None:
        if not self._received:
            return
        received, self._received = self._received, set()
        if len(received) < len(self._streams):
            self._torn = [cell for cell in self._paired if received.issuperset(cell.streams) and cell.leads()]
        strain, status = self._protocol.decode(self._data)
        self.counts.cycles += 1
        for p, cell in enumerate(self._cells):
            cell.counts.cycles_per_sample = cell.streams[-1].pace.cycles_per_sample
            if received.issuperset(cell.streams) and (cell not in self._torn or cell.settle()):
                cell.counts.samples += 1
            else:
                cell.counts.missing += 1
                strain[self._protocol.channels.slices[p]] = np.nan
                status[p] = MISSING
        self._torn = []
        if status.any():
            for p, (cell, bits) in enumerate(zip(self._cells, status, strict=True)):
                if bits & (SATURATED | FAULT):
                    self.counts.suspects[p] = bytes(self._data)
                cell.counts.saturated += bool(bits & SATURATED)
                cell.counts.faults += bool(bits & FAULT)
        first = [cell.streams[0] for cell in self._cells]
        numbers = [stream.sequence if stream.counter else self.counts.cycles for stream in first]
        sequence = np.array(numbers).astype(np.uint32)
        self._cycles.append(Cycle(self._first_ns, strain, status, sequence))
