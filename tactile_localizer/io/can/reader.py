"""The receive thread: reads a bus, and opens it again whenever it fails.

Only the thread touches the bus, so that nothing is closed under a read. It waits for frames in short
steps and so ends within a fraction of a second when told to.
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
"""Longest wait for a frame, after which the thread looks whether it should end."""

LINGER_S = 0.0005
"""How long frames are waited for that come together with the first one of a batch."""

MOST_AT_ONCE = 256
"""Most frames that are delivered at once when the thread has fallen behind."""

_ABSENT_POLL_S = 1.0
_QUEUE_PERIOD_S = 0.5
_EPOCH_TOLERANCE_S = 3600.0


@dataclass
class BusStatus:
    """What is known of the bus; written by the thread alone.

    Attributes
    ----------
    state : ``open``; ``bus off`` until a good frame arrives; ``failed`` until opened again; ``closed``;
        ``waiting for the interface`` that was absent at the start
    error : why the bus failed last, empty if it never did
    reconnects : how often it was opened again
    unreadable : messages of the interface that were not frames
    errors : error frames by what they report (:mod:`~tactile_localizer.io.can.error_frames`)
    queue_used, queue_limit : kernel's receive queue, bytes; 0 where the interface has none
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
    """Reads a bus in a thread of its own.

    Parameters
    ----------
    open_bus : opens the bus or raises a :class:`CanError`; called again after a failure
    deliver : takes frames in the order of their arrival, possibly none, and returns how long it can wait for
        the next ones, s. Called in the thread
    batch : frames that usually come together, which are then delivered together
    backoff_s : wait before the bus is opened again, s, doubled after each failure; 0: not opened again
        until :meth:`reconnect`
    backoff_limit_s : longest such wait, s
    wait : whether to wait for an interface that is absent when the reader starts
    opened : called in the thread before the frames of a newly opened bus are delivered
    log : takes a line when the bus fails
    note : takes a line when frames arrive, at the start and after a failure
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
        self._wake = threading.Event()  # the thread is to end, or to open the bus anew
        self._thread: threading.Thread | None = None
        self._drops_before = 0  # of buses that are closed by now
        self._next_queue_s = 0.0
        self._own_clock: bool | None = (
            None  # whether stamps are an adapter's own; None before the first frame
        )
        self._reopened = False
        self._noted = False  # whether it was said that frames arrive

    def start(self) -> None:
        """Open the bus and begin to read.

        Raises
        ------
        CanError
            The bus cannot be opened, and is not to be waited for.
        """
        if self._thread is not None and self._thread.is_alive():
            raise CanError("CAN receive thread: expected it to have ended, it is still at work")
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
        """End the thread and close the bus; whether both were done within ``timeout_s``."""
        if self._thread is None:
            return True
        self._stop.set()
        self._wake.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def reconnect(self) -> None:
        """Close the bus and open it again, at once."""
        self._wake.set()

    def _run(self, bus: can.BusABC | None) -> None:
        if bus is None:
            bus = self._reopen()
        while bus is not None and not self._stop.is_set():
            self._own_clock = None
            try:
                self._opened()
                self._read(bus)
            except _BusOffError:
                self._failed(BUS_OFF, "bus off")
            except (can.CanError, OSError, ValueError) as error:
                self._failed(FAILED, " ".join(str(error.__cause__ or error).split()))
            except Exception:  # a mistake of ours: told, and tried again like any other failure
                self._failed(FAILED, traceback.format_exc())
            finally:
                self._close(bus)
            bus = self._reopen()
        self.status.state = CLOSED

    def _read(self, bus: can.BusABC) -> None:
        # An interface that is down opens, and fails at the first read: only after that it is back.
        messages = self._collect(bus, LINGER_S)
        self._opened_well()
        while True:
            wait_s = self._deliver(messages)
            if messages:
                self._judge(messages)
            if time.monotonic() >= self._next_queue_s:
                self._look_at_queue(bus)
            if self._wake.is_set():
                return
            messages = self._collect(bus, min(wait_s, LONGEST_WAIT_S))

    def _opened_well(self) -> None:
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
        while len(messages) < MOST_AT_ONCE:  # what waits already is taken along
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
            self.status.unreadable += 1  # the bus is well, but what it brought was no frame
            return None
        if message is not None:
            if self._own_clock is None:
                self._own_clock = abs(time.time() - message.timestamp) > _EPOCH_TOLERANCE_S
            if self._own_clock:  # an adapter's clock, of unknown origin and rate
                message.timestamp = time.time()
        return message

    def _judge(self, messages: list[can.Message]) -> None:
        good = False
        for message in messages:
            if not message.is_error_frame:
                good = True
                continue
            kinds = error_kinds(message)
            self.status.errors.update(kinds)
            if BUS_OFF in kinds:
                raise _BusOffError
        if good and not self._noted:
            self._noted = True
            self._note("CAN bus: receiving again" if self.status.error else "CAN bus: receiving")
        if good and (self._delay_s != self._backoff_s or self.status.state != OPEN):
            self._delay_s = self._backoff_s
            self.status.state = OPEN

    def _failed(self, state: str, reason: str) -> None:
        self._noted = False
        if (state, reason) != (self.status.state, self.status.error):  # once, not at every attempt
            if state == WAITING:
                self._log(f"CAN bus is absent, waiting for it: {reason}")
            else:
                hope = "trying to open it again" if self._backoff_s else "closed until ~/reconnect is called"
                self._log(f"CAN bus failed, {hope}: {reason}")
        self.status.state = state
        self.status.error = reason

    def _reopen(self) -> can.BusABC | None:
        asked = self._wake.is_set()
        while True:
            if not asked:
                asked = self._wake.wait(self._pause_s())
            self._wake.clear()
            if self._stop.is_set():
                return None
            self._delay_s = self._backoff_s if asked else min(2 * self._delay_s, self._backoff_limit_s)
            asked = False
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
        self._look_at_queue(bus)
        self._drops_before = self.status.queue_drops
        try:
            bus.shutdown()
        except Exception as error:  # interfaces raise what they like, and the thread has to go on
            self._log(f"CAN bus: could not be closed: {error}")

    def _look_at_queue(self, bus: can.BusABC) -> None:
        self._next_queue_s = time.monotonic() + _QUEUE_PERIOD_S
        queue = receive_queue(bus)
        if queue is not None:
            self.status.queue_used = queue.used
            self.status.queue_limit = queue.limit
            self.status.queue_drops = self._drops_before + queue.drops


class _BusOffError(Exception):
    """The controller has left the bus."""
