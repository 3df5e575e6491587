"""The receive thread delivers frames in order, survives failures of the bus, and stops on request."""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Callable, Iterator

import can
import pytest
from can.interfaces.virtual import VirtualBus
from support.waiting import wait_until

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.bus import AbsentBusError
from tactile_localizer.io.can.error_frames import ERROR_PASSIVE, NO_ACKNOWLEDGEMENT, OTHER
from tactile_localizer.io.can.reader import CLOSED, FAILED, OPEN, WAITING, CanReader


class Line:
    """A virtual bus with a reader at one end; its interface can be taken away."""

    def __init__(self, channel: str, **kwargs: float) -> None:
        self.channel = channel
        self.up = True
        self.opened: list[can.BusABC] = []
        self.batches: list[list[can.Message]] = []
        self.log: list[str] = []
        self.notes: list[str] = []
        self.mistakes: list[str] = []  # raised by the receiver, one for each batch of frames
        self.sender = can.Bus(interface="virtual", channel=channel)
        self.reader = CanReader(self._open, self._take, log=self.log.append, note=self.notes.append, **kwargs)

    def _open(self) -> can.BusABC:
        if not self.up:
            raise AbsentBusError("interface is down")
        self.opened.append(can.Bus(interface="virtual", channel=self.channel))
        return self.opened[-1]

    def _take(self, messages: list[can.Message]) -> float:
        if messages and self.mistakes:
            raise KeyError(self.mistakes.pop())
        self.batches.append(messages)
        return 0.1

    @property
    def received(self) -> list[int]:
        return [message.arbitration_id for batch in self.batches for message in batch]

    def send(self, *identifiers: int, **kwargs: bool) -> None:
        for identifier in identifiers:
            self.sender.send(can.Message(arbitration_id=identifier, is_extended_id=False, **kwargs))

    def wait_for(self, *identifiers: int) -> None:
        wait_until(lambda: self.received == list(identifiers), f"frames {identifiers}", 5.0)

    def close(self) -> None:
        self.reader.stop()
        self.sender.shutdown()
        for bus in self.opened:
            bus.shutdown()


@pytest.fixture
def line(request: pytest.FixtureRequest) -> Iterator[Callable[..., Line]]:
    made: list[Line] = []

    def make(**kwargs: float) -> Line:
        made.append(Line(request.node.name, **kwargs))
        made[-1].reader.start()
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_frames_arrive_in_order(line: Callable[..., Line]) -> None:
    one = line(batch=4)
    one.send(*range(100))
    one.wait_for(*range(100))
    assert max(len(batch) for batch in one.batches) >= 4


def test_an_idle_bus_stays_open(line: Callable[..., Line]) -> None:
    one = line()
    wait_until(lambda: one.batches.count([]) >= 3, "three waits without a frame", 5.0)
    assert (one.reader.status.state, one.reader.status.reconnects, one.log) == (OPEN, 0, [])


def test_start_raises_if_the_bus_cannot_be_opened(request: pytest.FixtureRequest) -> None:
    one = Line(request.node.name)
    one.up = False
    with pytest.raises(CanError, match="interface is down"):
        one.reader.start()
    one.close()


def test_a_closed_bus_is_reopened(
    line: Callable[..., Line],
) -> None:
    one = line(backoff_s=0.01)
    for attempt in range(3):
        one.send(attempt)
        one.wait_for(*range(attempt + 1))
        one.opened[-1].shutdown()
        wait_until(lambda: one.reader.status.reconnects == attempt + 1, "the bus to be back", 5.0)  # noqa: B023
    assert one.reader.status.state == OPEN
    assert "closed" in one.reader.status.error
    assert len(one.log) == 3  # each failure once
    one.send(3)
    wait_until(lambda: len(one.notes) == 4, "a line for the frames after each failure", 5.0)
    assert [note.endswith("again") for note in one.notes] == [False, True, True, True]


def test_a_bus_is_open_after_the_first_read(
    line: Callable[..., Line], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = line(backoff_s=0.01)
    down, read = threading.Event(), VirtualBus._recv_internal

    def receive(bus: VirtualBus, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not down.is_set():
            return read(bus, timeout)
        error = OSError(errno.ENETDOWN, os.strerror(errno.ENETDOWN))  # as SocketCAN has it
        raise can.CanOperationError(f"Error receiving: {error.strerror}", error.errno) from error

    monkeypatch.setattr(VirtualBus, "_recv_internal", receive)
    down.set()
    wait_until(lambda: len(one.opened) >= 4, "three attempts", 5.0)
    assert (one.reader.status.state, one.reader.status.reconnects) == (FAILED, 0)
    assert "Network is down" in one.reader.status.error
    down.clear()
    wait_until(lambda: one.reader.status.state == OPEN, "the bus to be back", 5.0)
    one.send(7)
    one.wait_for(7)
    assert one.reader.status.reconnects == 1
    assert len(one.log) == 1
    assert len(one.notes) == 1


def test_backoff_doubles_up_to_the_limit(line: Callable[..., Line], monkeypatch: pytest.MonkeyPatch) -> None:
    one = line(backoff_s=0.01, backoff_limit_s=0.04)
    waits: list[float | None] = []
    wait = threading.Event.wait

    def recorded(event: threading.Event, timeout_s: float | None = None) -> bool:
        if threading.current_thread().name == "can-reader":
            waits.append(timeout_s)
        return wait(event, timeout_s)

    monkeypatch.setattr(threading.Event, "wait", recorded)
    one.up = False
    one.opened[-1].shutdown()
    wait_until(lambda: len(waits) >= 5, "five attempts", 5.0)
    assert waits[:5] == [0.01, 0.02, 0.04, 0.04, 0.04]
    assert one.reader.status.state == FAILED
    assert len(one.log) == 2  # not a line per attempt
    one.up = True
    wait_until(lambda: one.reader.status.state == OPEN, "the bus to be back", 5.0)
    one.send(7)
    one.wait_for(7)
    waits.clear()
    one.opened[-1].shutdown()
    wait_until(lambda: waits, "another attempt", 5.0)
    assert waits[0] == 0.01, "starts again after a data frame"


def test_without_backoff_only_reconnect_reopens(
    line: Callable[..., Line],
) -> None:
    one = line(backoff_s=0.0)
    one.opened[-1].shutdown()
    wait_until(lambda: one.reader.status.state == FAILED, "the failure", 5.0)
    assert len(one.opened) == 1
    one.reader.reconnect()
    wait_until(lambda: one.reader.status.state == OPEN, "the bus to be back", 5.0)
    assert len(one.opened) == 2


def test_error_frames_are_counted_by_kind(line: Callable[..., Line]) -> None:
    one = line()
    one.send(0x20, 0x20, is_error_frame=True)  # no acknowledgement
    controller = can.Message(
        arbitration_id=0x04, is_error_frame=True, data=bytes([0, 0x20, 0, 0, 0, 0, 0, 0])
    )
    one.sender.send(controller)
    one.send(0, is_error_frame=True)
    wait_until(lambda: sum(one.reader.status.errors.values()) == 4, "four error frames", 5.0)
    assert one.reader.status.errors == {NO_ACKNOWLEDGEMENT: 2, ERROR_PASSIVE: 1, OTHER: 1}
    assert (one.reader.status.state, one.reader.status.reconnects) == (OPEN, 0)
    assert one.notes == []


def test_the_reader_can_wait_for_an_absent_interface(request: pytest.FixtureRequest) -> None:
    one = Line(request.node.name, wait=True, backoff_s=0.01)
    one.up = False
    one.reader.start()
    try:
        assert one.reader.status.state == WAITING
        (line_logged,) = one.log
        assert "interface is down" in line_logged
        one.up = True
        wait_until(lambda: one.reader.status.state == OPEN, "the bus", 5.0)
        one.send(5)
        one.wait_for(5)
        assert one.reader.status.reconnects == 0
        assert len(one.log) == 1
        assert len(one.notes) == 1
    finally:
        one.close()


def test_bugs_in_the_receiver_do_not_end_the_thread(line: Callable[..., Line]) -> None:
    one = line(backoff_s=0.01)
    one.mistakes.append("a mistake")
    one.send(1)
    wait_until(lambda: one.reader.status.reconnects == 1, "the bus to be opened again", 5.0)
    assert "a mistake" in one.log[0]
    one.send(2)
    one.wait_for(2)


def test_a_failing_close_is_reported(line: Callable[..., Line]) -> None:
    one = line(backoff_s=0.01)
    bus, closed = one.opened[-1], one.opened[-1].shutdown

    def shutdown() -> None:
        closed()
        raise AttributeError("no handle")  # interfaces raise what they like

    bus.shutdown = shutdown  # type: ignore[method-assign]
    one.reader.reconnect()
    wait_until(lambda: one.reader.status.reconnects == 1, "the bus to be opened again", 5.0)
    assert "no handle" in one.log[0]
    bus.shutdown = closed  # type: ignore[method-assign]
    one.send(3)
    one.wait_for(3)


@pytest.mark.parametrize("state", ["reading", "waiting to open again"])
def test_stop_takes_less_than_a_second(line: Callable[..., Line], state: str) -> None:
    one = line(backoff_s=30.0)
    if state != "reading":
        one.up = False
        one.opened[-1].shutdown()
        wait_until(lambda: one.reader.status.state == FAILED, "the failure", 5.0)
    before = time.monotonic()
    assert one.reader.stop()
    assert time.monotonic() - before < 1.0
    assert one.reader.status.state == CLOSED
    assert "can-reader" not in [thread.name for thread in threading.enumerate()]
    with pytest.raises(can.CanError):
        one.opened[-1].recv(0)


def test_adapter_stamps_are_replaced(
    line: Callable[..., Line],
) -> None:
    one = line()
    adapter = can.Bus(interface="virtual", channel=one.channel, preserve_timestamps=True)
    adapter.send(can.Message(arbitration_id=1, timestamp=12.5))
    adapter.shutdown()
    one.wait_for(1)
    (stamp,) = [message.timestamp for batch in one.batches for message in batch]
    assert abs(stamp - time.time()) < 60
