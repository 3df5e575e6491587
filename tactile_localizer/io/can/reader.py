"""Receive thread that reads a CAN bus and reopens it after failures.

Only this thread accesses the bus, so the bus is never closed during a read. The thread waits for frames in
short steps and therefore stops within a fraction of a second.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import can

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.bus import AbsentBusError, receive_queue
from tactile_localizer.io.can.error_frames import BUS_OFF, error_kinds

OPEN = "open"
FAILED = "failed"
WAITING = "waiting for the interface"
CLOSED = "closed"

LONGEST_WAIT_S = 0.1
"""Longest wait for a frame, after which the thread checks whether it should stop, s."""

LINGER_S = 0.0005
"""Time to wait for the other frames of a batch after its first one, s: half a cycle at 1 kHz."""

MAX_BATCH_FRAMES = 256
"""Most frames delivered at once if the thread has fallen behind."""

_ABSENT_POLL_S = 1.0
"""Period of attempts to open an absent interface, s."""

_QUEUE_PERIOD_S = 0.5
"""Period of reading the kernel's receive queue, s; diagnostics are published every second."""

_EPOCH_TOLERANCE_S = 3600.0
"""Difference from the system's clock from which stamps are those of an adapter's own clock, s."""


@dataclass
class BusStatus:
    """State of the bus, written only by the receive thread.

    Attributes
    ----------
    state : ``open``; ``bus off`` until a data frame is received; ``failed`` until reopened; ``closed``;
        ``waiting for the interface`` that was absent at the start
    error : reason of the last failure; empty before the first
    reconnects : number of times that the bus was reopened
    unreadable : number of messages of the interface that were not frames
    errors : number of error frames by kind (:mod:`~tactile_localizer.io.can.error_frames`)
    queue_used, queue_limit : kernel's receive queue, bytes; 0 if the interface has none
    queue_drops : frames that the kernel dropped because the queue was full
    """

    state: str = CLOSED
    error: str = ""
    reconnects: int = 0
    unreadable: int = 0
    errors: Counter[str] = field(default_factory=Counter)
    queue_used: int = 0
    queue_limit: int = 0
    queue_drops: int = 0


class CanReader:
    """Reads a bus in a separate thread.

    Parameters
    ----------
    open_bus : opens the bus or raises a :class:`CanError`; called again after a failure
    deliver : called in the thread with frames in order of reception, possibly none; returns how long it can
        wait for the next ones, s
    batch : number of frames that are usually received together, and then delivered together
    backoff_s : delay before the bus is reopened, s, doubled after each failure; 0: not reopened until
        :meth:`reconnect`
    backoff_limit_s : longest delay, s
    wait : whether to wait for an interface that is absent when the reader starts
    opened : called in the thread before the frames of a newly opened bus are delivered
    log : called with a line when the bus fails
    note : called with a line when frames are received, at the start and after a failure
    """

    def __init__(
        self,
        open_bus: Callable[[], can.BusABC],
        deliver: Callable[[list[can.Message]], float],
        *,
        batch: int = 1,
        backoff_s: float = 0.1,
        backoff_limit_s: float = 5.0,
        wait: bool = False,
        opened: Callable[[], None] = lambda: None,
        log: Callable[[str], None] = lambda line: None,
        note: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.status = BusStatus()
        self._open_bus = open_bus
        self._deliver = deliver
        self._batch = batch
        self._backoff_s = backoff_s
        self._backoff_limit_s = backoff_limit_s
        self._opened = opened
        self._log = log
        self._note = note
        self._wait = wait
        self._delay_s = backoff_s
        self._stop = threading.Event()
        self._wake = threading.Event()  # the thread shall stop, or reopen the bus
        self._thread: threading.Thread | None = None
        self._drops_before = 0  # of earlier buses
        self._next_queue_s = 0.0
        self._has_adapter_clock: bool | None = None  # None before the first frame
        self._reopened = False
        self._noted = False  # whether the reception of frames was reported

    def start(self) -> None:
        """Open the bus and start the thread.

        Raises
        ------
        CanError
            The bus cannot be opened, unless it is absent and the reader waits for it.
        """
        if self._thread is not None and self._thread.is_alive():
            raise CanError("CAN receive thread: expected it to have stopped, it is still running")
        bus = self._open_first()
        self._stop.clear()
        self._reopened = False
        self._noted = False
        self._wake.clear()
        self._thread = threading.Thread(target=self._run, args=(bus,), name="can-reader", daemon=True)
        self._thread.start()

    def _open_first(self) -> can.BusABC | None:
        try:
            return self._open_bus()
        except AbsentBusError as error:
            if not self._wait:
                raise
            self._failed(WAITING, str(error))
            return None

    def stop(self, timeout_s: float = 1.0) -> bool:
        """Stop the thread and close the bus; returns whether that succeeded within ``timeout_s``."""
        if self._thread is None:
            return True
        self._stop.set()
        self._wake.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def reconnect(self) -> None:
        """Close and reopen the bus without delay."""
        self._wake.set()

    def _run(self, bus: can.BusABC | None) -> None:
        if bus is None:
            bus = self._reopen()
        while bus is not None and not self._stop.is_set():
            self._has_adapter_clock = None
            try:
                self._opened()
                self._read(bus)
            except _BusOffError:
                self._failed(BUS_OFF, "bus off")
            except (can.CanError, OSError, ValueError) as error:
                self._failed(FAILED, " ".join(str(error.__cause__ or error).split()))
            except Exception:  # a bug in this package: reported, and handled like any other failure
                self._failed(FAILED, traceback.format_exc())
            finally:
                self._close(bus)
            bus = self._reopen()
        self.status.state = CLOSED

    def _read(self, bus: can.BusABC) -> None:
        # An interface that is down can be opened, but the first read fails.
        messages = self._collect(bus, LINGER_S)
        self._set_open()
        while True:
            wait_s = self._deliver(messages)
            if messages:
                self._update_state(messages)
            if time.monotonic() >= self._next_queue_s:
                self._read_queue(bus)
            if self._wake.is_set():
                return
            messages = self._collect(bus, min(wait_s, LONGEST_WAIT_S))

    def _set_open(self) -> None:
        if self._reopened and self.status.state != WAITING:
            self.status.reconnects += 1
        self._reopened = False
        if self.status.state != BUS_OFF:
            self.status.state = OPEN

    def _collect(self, bus: can.BusABC, wait_s: float) -> list[can.Message]:
        message = self._receive(bus, wait_s)
        if message is None:
            return []
        messages = [message]
        until_s = time.monotonic() + LINGER_S
        while len(messages) < MAX_BATCH_FRAMES:  # frames that wait already are included
            missing = len(messages) < self._batch
            message = self._receive(bus, max(0.0, until_s - time.monotonic()) if missing else 0.0)
            if message is None:
                break
            messages.append(message)
        return messages

    def _receive(self, bus: can.BusABC, wait_s: float) -> can.Message | None:
        try:
            message = bus.recv(wait_s)
        except can.CanOperationError as error:
            if error.__cause__ is None or isinstance(error.__cause__, OSError):
                raise
            self.status.unreadable += 1  # the bus works, but the message was not a frame
            return None
        if message is not None:
            if self._has_adapter_clock is None:
                self._has_adapter_clock = abs(time.time() - message.timestamp) > _EPOCH_TOLERANCE_S
            if self._has_adapter_clock:  # an adapter's clock, of unknown origin and rate
                message.timestamp = time.time()
        return message

    def _update_state(self, messages: list[can.Message]) -> None:
        has_data = False
        for message in messages:
            if not message.is_error_frame:
                has_data = True
                continue
            kinds = error_kinds(message)
            self.status.errors.update(kinds)
            if BUS_OFF in kinds:
                raise _BusOffError
        if has_data and not self._noted:
            self._noted = True
            self._note("CAN bus: receiving again" if self.status.error else "CAN bus: receiving")
        if has_data and (self._delay_s != self._backoff_s or self.status.state != OPEN):
            self._delay_s = self._backoff_s
            self.status.state = OPEN

    def _failed(self, state: str, reason: str) -> None:
        self._noted = False
        if (state, reason) != (self.status.state, self.status.error):  # once, not at every attempt
            if state == WAITING:
                self._log(f"CAN bus is absent, waiting for it: {reason}")
            else:
                action = (
                    "trying to open it again" if self._backoff_s else "closed until ~/reconnect is called"
                )
                self._log(f"CAN bus failed, {action}: {reason}")
        self.status.state = state
        self.status.error = reason

    def _reopen(self) -> can.BusABC | None:
        requested = self._wake.is_set()
        while True:
            if not requested:
                requested = self._wake.wait(self._pause_s())
            self._wake.clear()
            if self._stop.is_set():
                return None
            self._delay_s = self._backoff_s if requested else min(2 * self._delay_s, self._backoff_limit_s)
            requested = False
            try:
                bus = self._open_bus()
            except CanError as error:
                state = self.status.state if self.status.state in (BUS_OFF, WAITING) else FAILED
                self._failed(state, str(error))
                continue
            self._reopened = True
            return bus

    def _pause_s(self) -> float | None:
        if self._backoff_s:
            return self._delay_s
        return _ABSENT_POLL_S if self.status.state == WAITING else None

    def _close(self, bus: can.BusABC) -> None:
        self._read_queue(bus)
        self._drops_before = self.status.queue_drops
        try:
            bus.shutdown()
        except Exception as error:  # interfaces raise many types of exceptions; the thread must continue
            self._log(f"CAN bus: could not be closed: {error}")

    def _read_queue(self, bus: can.BusABC) -> None:
        self._next_queue_s = time.monotonic() + _QUEUE_PERIOD_S
        queue = receive_queue(bus)
        if queue is not None:
            self.status.queue_used = queue.used
            self.status.queue_limit = queue.limit
            self.status.queue_drops = self._drops_before + queue.drops


class _BusOffError(Exception):
    """The controller has left the bus."""
