"""Driver of a hand's load cells: reads a CAN bus in a thread, whatever happens to its interface.

Absent, down and lost are one state: the bus is waited for. A socket of the kernel stays open while its
interface is down or its controller off the bus, and then delivers again; any other bus is opened again.

Only this thread accesses the bus, so the bus is never closed during a read. The thread waits for frames in
short steps and therefore stops within a fraction of a second.
"""

import errno
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import can
import numpy as np
from can.interfaces.socketcan import SocketcanBus

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.assembler import Cycle, CycleAssembler
from tactile_localizer.io.can.bus import (
    HOST_CLOCK_INTERFACES,
    AbsentBusError,
    BusSettings,
    Link,
    ReceiveQueue,
    link_of,
    open_bus,
    receive_queue,
)
from tactile_localizer.io.can.clock import LONGEST_WAKEUP_S, SenderClock
from tactile_localizer.io.can.error_frames import BUS_OFF, ERROR_ACTIVE, read_error_frame
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.can.tare import tare_offset

OPEN = "open"
WAITING = "waiting"
CLOSED = "closed"

LONGEST_WAIT_S = 0.1
"""Longest wait for a frame, after which the thread checks whether it should stop, s."""

MAX_BATCH_FRAMES = 256
"""Most frames delivered at once if the thread has fallen behind."""

RETRY_S = 0.1
"""Period of attempts to open a bus, s; opening fails or succeeds within a few milliseconds."""

STOP_TIMEOUT_S = 5.0
"""Longest time for the thread to stop, s: a fraction of a second, unless a busy machine puts it aside."""

_POLL_PERIOD_S = 0.5
"""Period of reading the interface and its receive queue, s; diagnostics are published every second."""

SILENCE_S = 2.0
"""Time without frames of a load cell after which the load cells are started again, s."""


@dataclass
class BusStatus:
    """State of the bus, written only by the receive thread.

    Attributes
    ----------
    state : ``open``, ``waiting`` (for an interface that is absent, down or lost), ``closed``
    controller : last known state of the CAN controller (:mod:`~tactile_localizer.io.can.error_frames`)
    error : reason of the last failure; empty before the first
    error_s : system time of the last failure, s
    reconnects : number of times that the bus was open again after a failure
    unreadable : number of messages of the interface that were not frames
    errors : number of errors by kind that error frames reported
    queue : kernel's receive queue
    queue_drops : frames that the kernel dropped because the queue was full
    link : interface of the kernel; ``None`` without one
    foreign : frames received by the interface since the last one that was delivered to the reader
    clock : clock that stamps the frames; ``None`` if it is that of this machine's kernel
    """

    state: str = CLOSED
    controller: str = ERROR_ACTIVE
    error: str = ""
    error_s: float = 0.0
    reconnects: int = 0
    unreadable: int = 0
    errors: Counter[str] = field(default_factory=Counter)
    queue: ReceiveQueue = field(default_factory=lambda: ReceiveQueue(0, 0))
    queue_drops: int = 0
    link: Link | None = None
    foreign: int = 0
    clock: SenderClock | None = None


class LoadCellDriver:
    """Reads load cells in a thread and delivers cycles.

    Parameters
    ----------
    protocol : layout of the frames
    bus : bus to open
    on_cycle : called in the receive thread with each cycle, after subtraction of the tare offset
    log : called with a line when the bus fails or its controller changes its state
    note : called with a line when the bus is open, also after a failure
    period_s : period of the samples, s; 0: estimated
    max_age_s : age from which frames are discarded, s: when the thread was late, the newest ones are used

    Attributes
    ----------
    protocol, bus, max_age_s : as given
    status : state of the bus
    offset : (C,) V, subtracted from each strain vector
    assembler : assembly of the frames, with its period
    counts : totals of frames, cycles and phalanges
    read_ns : time up to which the bus was read, ns: receive time of the newest frame, or when there was none
    late_ns : greatest age of a frame when it was read, ns; its reader sets it to 0
    """

    def __init__(
        self,
        protocol: LoadCellProtocol,
        bus: BusSettings,
        on_cycle: Callable[[Cycle], None],
        log: Callable[[str], None],
        note: Callable[[str], None],
        *,
        period_s: float = 0.0,
        max_age_s: float = 0.2,
    ) -> None:
        self.protocol, self.bus, self.max_age_s = protocol, bus, max_age_s
        self.status = BusStatus(clock=None if bus.interface in HOST_CLOCK_INTERFACES else SenderClock())
        self.offset = np.zeros(protocol.channels.size)
        self.read_ns, self.late_ns = time.time_ns(), 0
        self.assembler = CycleAssembler(protocol, period_s)
        self.counts = self.assembler.counts
        self._on_cycle, self._log, self._note = on_cycle, log, note
        self._at_rest: list[Cycle] | None = None  # cycles during a tare
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._drops_before = 0  # of earlier buses
        self._next_poll_s = 0.0
        self._started_s = 0.0  # system time at which the load cells were last started
        self._unsent = ""  # why frames could not be sent
        self._is_foreign = True  # whether no frame was read since the last poll
        self._empty_s = 0.0  # system time at which the bus was last found empty
        self._jumps_logged = 0  # of the sender's clock

    def start(self) -> None:
        """Start the thread, which opens the bus as soon as that is possible.

        Raises
        ------
        CanError
            There is no such bus; it is not merely absent or down.
        """
        if self._thread is not None and self._thread.is_alive():
            raise CanError("CAN receive thread: expected it to have stopped, it is still running")
        try:
            bus = self._open_bus()
        except AbsentBusError:
            bus = None
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, args=(bus,), name="can-reader", daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float = STOP_TIMEOUT_S) -> bool:
        """Stop the thread and close the bus; returns whether that succeeded within ``timeout_s``."""
        if self._thread is None:
            return True
        self._stop.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def tare(self, duration_s: float, spread_limit: float) -> np.ndarray:
        """Average the strain for ``duration_s``, and subtract it from now on; returns the offset (C,), V.

        Must not be called in the receive thread, which continues during the tare.

        Raises
        ------
        MeasurementError
            Too few valid samples were received, or the hand moved; the offset is unchanged.
        """
        at_rest: list[Cycle] = []
        self._at_rest = at_rest
        self._stop.wait(duration_s)
        self._at_rest = None
        cycles = list(at_rest)  # the receive thread may append a last one
        self.offset = tare_offset(cycles, self.protocol.phalanges, self.protocol.channels, spread_limit)
        return self.offset

    def _open_bus(self) -> can.BusABC:
        return open_bus(self.bus, self.protocol)

    def _run(self, bus: can.BusABC | None) -> None:
        while not self._stop.is_set():
            try:
                if bus is None:
                    self._deliver([])
                    bus = self._open_bus()
                self._read(bus)  # until the thread is to stop
                self._command(self.bus.commands.end, bus)
            except Exception as error:
                self._wait_for_bus(error)
                is_down = getattr(error, "error_code", None) == errno.ENETDOWN
                if is_down and isinstance(bus, SocketcanBus):
                    continue
            self._close(bus)
            bus = None
            self._stop.wait(RETRY_S)
        self._close(bus)
        self.status.state = CLOSED

    def _read(self, bus: can.BusABC) -> None:
        self._next_poll_s, self._empty_s = 0.0, time.time()
        wait_s = 0.0
        while not self._stop.is_set():
            messages = self._collect(bus, min(wait_s, LONGEST_WAIT_S))  # fails if the interface is down
            if time.monotonic() >= self._next_poll_s or (messages and self.status.state != OPEN):
                self._poll(bus)  # frames also wait in the queue of an interface that is down
            # What was received before an error frame is used before the controller's new state.
            starts = [0, *(k for k, message in enumerate(messages) if k and message.is_error_frame)]
            for begin, end in pairwise([*starts, len(messages)]):
                self._update_status(messages[begin:end])
                wait_s = self._deliver(messages[begin:end])
            if len(messages) == MAX_BATCH_FRAMES:
                wait_s = 0.0  # the next frame has probably waited

    def _collect(self, bus: can.BusABC, wait_s: float) -> list[can.Message]:
        """The frames that wait, or the first one that is received within ``wait_s``."""
        messages: list[can.Message] = []
        while len(messages) < MAX_BATCH_FRAMES:
            message = self._receive(bus, 0.0 if messages else wait_s)
            if message is None:
                break
            messages.append(message)
        return messages

    def _receive(self, bus: can.BusABC, wait_s: float) -> can.Message | None:
        asked_s = time.time()
        try:
            message = bus.recv(wait_s)
        except can.CanOperationError as error:
            if error.__cause__ is None or isinstance(error.__cause__, OSError):
                raise
            self.status.unreadable += 1  # the bus works, but the message was not a frame
            return None
        if message is None:
            self._empty_s = asked_s + wait_s
        elif self.status.clock is not None:
            read_s = time.time()
            if LONGEST_WAKEUP_S < read_s - asked_s < wait_s + LONGEST_WAKEUP_S:  # it waited for the frame
                self._empty_s = read_s - LONGEST_WAKEUP_S
            message.timestamp = self.status.clock.receipt_s(message.timestamp, self._empty_s, read_s)
        return message

    def _update_status(self, messages: list[can.Message]) -> None:
        """Use the state of the bus that messages show, of which only the first can be an error frame."""
        if messages and messages[0].is_error_frame:
            errors, state = read_error_frame(messages[0])
            self.status.errors.update(errors)
            self._set_controller(state or self.status.controller)
            messages = messages[1:]
        if messages:
            link = self.status.link
            if self.status.controller == BUS_OFF or link is None or not link.controller:
                self._set_controller(ERROR_ACTIVE)  # the kernel does not know, or not yet
            self._is_foreign, self.status.foreign = False, 0

    def _set_open(self) -> None:
        if self.status.state != OPEN:
            self.status.reconnects += self.status.state == WAITING
            self.status.state = OPEN
            self.assembler.reset()  # frames may have been missed without a trace
            limit, wanted = self.status.queue.limit, self.bus.receive_buffer
            short = f", with a receive buffer of {limit} instead of {wanted} bytes (net.core.rmem_max)"
            self._note("CAN bus: open" + (short if 0 < limit < wanted else ""))

    def _set_controller(self, state: str) -> None:
        before, self.status.controller = self.status.controller, state
        if state != before:
            self._log(f"CAN controller: {state}")
            if BUS_OFF in (state, before):
                self.assembler.reset()

    def _wait_for_bus(self, error: Exception) -> None:
        reason = str(error) if isinstance(error, CanError) else str(error.__cause__ or error)
        if not isinstance(error, CanError | can.CanError | OSError | ValueError):  # a bug in this package
            reason = traceback.format_exc()
        if (self.status.state, self.status.error) != (WAITING, reason):  # once, not at every attempt
            self._log(f"waiting for the CAN bus: {reason}")
        self.status.state, self.status.error, self.status.error_s = WAITING, reason, time.time()

    def _close(self, bus: can.BusABC | None) -> None:
        if bus is None:
            return
        self.status.state = WAITING
        self._read_queue(bus)
        self._drops_before = self.status.queue_drops
        try:
            bus.shutdown()
        except Exception as error:  # interfaces raise many types of exceptions; the thread must continue
            self._log(f"CAN bus: could not be closed: {error}")

    def _poll(self, bus: can.BusABC) -> None:
        """Read what the kernel knows about the bus."""
        self._next_poll_s = time.monotonic() + _POLL_PERIOD_S
        self._read_queue(bus)
        link, before = link_of(bus), self.status.link
        if link is not None and before is not None and self._is_foreign:
            self.status.foreign += max(0, link.received - before.received)
        self.status.link, self._is_foreign = link, True
        clock = self.status.clock
        if clock is not None and clock.jumps > self._jumps_logged:
            self._jumps_logged = clock.jumps
            self._log(f"clock of the sender: jumped by {clock.jump_s:+.3f} s")
        if link is None or link.is_up:
            self._start_load_cells(bus)
            self._set_open()
            self._set_controller((link and link.controller) or self.status.controller)

    def _start_load_cells(self, bus: can.BusABC) -> None:
        """Send the start frames if the bus has just opened, or a load cell is silent."""
        now_s, last_s = time.time(), 1e-9 * min(cell.last_ns for cell in self.counts.phalanges)
        if self.status.state != OPEN or now_s - max(last_s, self._started_s) > SILENCE_S:
            self._started_s = now_s
            self._command(self.bus.commands.begin, bus)

    def _command(self, command: Callable[[can.BusABC], None], bus: can.BusABC) -> None:
        reason = ""
        try:
            command(bus)
        except Exception as error:  # interfaces raise many types of exceptions; reading continues
            reason = f"CAN bus: frames could not be sent: {error.__cause__ or error}"
        if reason not in ("", self._unsent):  # once, not at every attempt
            self._log(reason)
        self._unsent = reason

    def _read_queue(self, bus: can.BusABC) -> None:
        self.status.queue = receive_queue(bus) or ReceiveQueue(0, 0)
        self.status.queue_drops = self._drops_before + self.status.queue.drops

    def _deliver(self, messages: list[can.Message]) -> float:
        """Use frames in order of reception, possibly none; returns how long it can wait for the next, s."""
        now_ns = self.read_ns = time.time_ns()
        if messages:
            self.read_ns = round(messages[-1].timestamp * 1e9)
            self.late_ns = max(self.late_ns, now_ns - round(messages[0].timestamp * 1e9))
            cycles = self.assembler.feed(messages, now_ns - round(self.max_age_s * 1e9))
        else:
            cycles = self.assembler.flush(now_ns)
        at_rest = self._at_rest
        for cycle in cycles:
            if at_rest is not None:
                at_rest.append(cycle)
            strain = cycle.strain - self.offset
            self._on_cycle(Cycle(cycle.stamp_ns, strain, cycle.status, cycle.sequence))
        remaining_ns = self.assembler.remaining_ns(time.time_ns())
        return LONGEST_WAIT_S if remaining_ns is None else remaining_ns * 1e-9
