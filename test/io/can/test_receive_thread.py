"""The receive thread delivers frames in order, survives failures of the bus, and stops on request."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import ClassVar

import can
import pytest
from can.interfaces.virtual import VirtualBus
from support.load_cells import protocol
from support.waiting import PATIENCE_S, wait_until

from tactile_localizer.errors import CanError
from tactile_localizer.io.can import driver
from tactile_localizer.io.can.bus import AbsentBusError, BusSettings, Link, ReceiveQueue
from tactile_localizer.io.can.clock import SenderClock
from tactile_localizer.io.can.commands import Commands, parse_frames
from tactile_localizer.io.can.driver import CLOSED, OPEN, WAITING, LoadCellDriver
from tactile_localizer.io.can.error_frames import (
    BUS_OFF,
    ERROR_ACTIVE,
    ERROR_PASSIVE,
    ERROR_WARNING,
    NO_ACKNOWLEDGEMENT,
    OTHER,
    read_error_frame,
)


class Line(LoadCellDriver):
    """A driver at one end of a virtual bus, which keeps the frames; its interface can be taken away."""

    def __init__(self, channel: str, up: bool = True, commands: Commands | None = None) -> None:
        self.log: list[str] = []
        self.notes: list[str] = []
        bus = BusSettings("virtual", channel, commands=commands or Commands())
        super().__init__(protocol(), bus, print, self.log.append, self.notes.append)
        self.assembler.reset = self._interrupted  # type: ignore[method-assign]
        self.channel = channel
        self.up = up
        self.opened: list[can.BusABC] = []
        self.batches: list[list[can.Message]] = []
        self.mistakes: list[str] = []  # raised by the receiver, one for each batch of frames
        self.interruptions = self.dropped = 0
        self.queue: can.BusABC | None = None  # the next bus to open; frames wait in it
        self.sender = can.Bus(interface="virtual", channel=channel)

    def _open_bus(self) -> can.BusABC:
        if not self.up:
            raise AbsentBusError("interface is down")
        self.opened.append(self.queue or self.bus_of_its_own())
        self.queue, self.dropped = None, 0
        return self.opened[-1]

    def bus_of_its_own(self) -> can.BusABC:
        return can.Bus(interface="virtual", channel=self.channel)

    def _deliver(self, messages: list[can.Message]) -> float:
        if messages and self.mistakes:
            raise KeyError(self.mistakes.pop())
        self.batches.append(messages)
        return 0.1

    def _interrupted(self) -> None:
        self.interruptions += 1

    @property
    def received(self) -> list[int]:
        return [message.arbitration_id for batch in self.batches for message in batch]

    def send(self, *identifiers: int, **kwargs: bool) -> None:
        for identifier in identifiers:
            self.sender.send(can.Message(arbitration_id=identifier, is_extended_id=False, **kwargs))

    def wait_for(self, *identifiers: int) -> None:
        wait_until(lambda: self.received == list(identifiers), f"frames {identifiers}")

    def close(self) -> None:
        self.stop()
        self.sender.shutdown()
        for bus in self.opened:
            bus.shutdown()


@pytest.fixture
def line(request: pytest.FixtureRequest) -> Iterator[Callable[..., Line]]:
    made: list[Line] = []

    def make(**kwargs: int) -> Line:
        made.append(Line(request.node.name, **kwargs))
        made[-1].start()
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_frames_arrive_in_order(line: Callable[..., Line]) -> None:
    one = line(up=False)
    one.queue = one.bus_of_its_own()
    one.send(*range(1000))
    one.up = True
    one.wait_for(*range(1000))
    delivered = [len(batch) for batch in one.batches if batch]
    assert delivered == [256, 256, 256, 232], "those that wait together, but not so many that it takes long"


def test_an_idle_bus_stays_open(line: Callable[..., Line]) -> None:
    one = line()
    wait_until(lambda: one.batches.count([]) >= 3, "three waits without a frame")
    assert (one.status.state, one.status.reconnects, one.log) == (OPEN, 0, [])


def test_a_bus_that_cannot_be_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(line: Line) -> can.BusABC:
        raise CanError("no such interface")

    monkeypatch.setattr(Line, "_open_bus", refuse)
    one = Line("refused")
    with pytest.raises(CanError, match="no such interface"):
        one.start()
    one.close()


def test_an_absent_and_a_lost_bus_are_waited_for(
    line: Callable[..., Line], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = line(up=False)
    monkeypatch.setattr(driver, "receive_queue", lambda bus: ReceiveQueue(0, one.dropped))
    wait_until(lambda: one.status.error, "the first attempt")
    first_s = one.status.error_s
    wait_until(lambda: one.status.error_s > first_s, "another attempt")
    assert one.status.state == WAITING
    assert one.log == ["waiting for the CAN bus: interface is down"]  # not a line per attempt
    one.up = True
    for attempt in range(3):
        wait_until(lambda: one.notes == (attempt + 1) * ["CAN bus: open"], "the bus to be open")  # noqa: B023
        assert (one.status.state, one.status.reconnects) == (OPEN, attempt + 1)
        assert one.interruptions == attempt + 1
        one.send(attempt)
        one.wait_for(*range(attempt + 1))
        assert one.status.queue_drops == 5 * attempt, "those of the lost buses"
        one.dropped = 5
        one.opened[-1].shutdown()
    wait_until(lambda: len(one.log) == 4, "the last failure")
    assert "closed" in one.status.error


def test_error_frames_are_errors_or_states_of_the_controller(line: Callable[..., Line]) -> None:
    one = line()
    one.send(0x20, 0x20, is_error_frame=True)  # no acknowledgement
    one.send(0, is_error_frame=True)
    one.send(0x40, is_error_frame=True)
    status = one.status
    wait_until(lambda: status.controller == BUS_OFF, "bus off")
    assert status.errors == {NO_ACKNOWLEDGEMENT: 2, OTHER: 1}
    assert (status.state, status.reconnects) == (OPEN, 0)
    one.send(7)
    wait_until(lambda: one.interruptions == 3, "a frame to show that the controller is back")
    assert status.controller == ERROR_ACTIVE
    assert one.log == ["CAN controller: bus off", "CAN controller: error active"]
    assert len(one.opened) == 1


@pytest.mark.parametrize(
    ("detail", "found"),
    [
        (0x01, (["receive overflow"], "")),
        (0x08, ([], ERROR_WARNING)),
        (0x10, ([], ERROR_PASSIVE)),
        (0x40, ([], ERROR_ACTIVE)),
    ],
)
def test_details_of_an_error_frame_are_read(detail: int, found: tuple[list[str], str]) -> None:
    frame = can.Message(arbitration_id=0x04, is_error_frame=True, data=[0, detail, 0, 0, 0, 0, 0, 0])
    assert read_error_frame(frame) == found


def test_frames_before_a_bus_off_are_used_before_it(line: Callable[..., Line]) -> None:
    one, received = line(up=False), list[list[int]]()
    one.queue = one.bus_of_its_own()
    one.send(1, 2)
    one.send(0x40, is_error_frame=True)
    one.send(3)
    one.assembler.reset = lambda: received.append(one.received)  # type: ignore[method-assign]
    one.up = True
    one.wait_for(1, 2, 0x40, 3)
    assert received == [[], [1, 2], [1, 2]], "the bus opens, goes off and returns"


def sent_to(one: Line) -> list[str]:
    """Frames that the load cells have received."""
    found = []
    while (frame := one.sender.recv(0)) is not None:
        found.append(f"{frame.arbitration_id:03X}#{frame.data.hex().upper()}")
    return found


def test_load_cells_are_started_with_the_bus_and_again_while_one_is_silent(
    line: Callable[..., Line], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "_POLL_PERIOD_S", 0.0)
    one = line(commands=Commands(start=parse_frames(["064#0B", "065#0B"])))
    wait_until(lambda: one.status.state == OPEN, "the bus")
    assert sent_to(one) == ["064#0B", "065#0B"]
    one.counts.phalanges[0].last_ns = time.time_ns() + 10**12
    monkeypatch.setattr(driver, "SILENCE_S", 0.0)
    wait_until(lambda: sent_to(one), "the start frames, because the other load cell is silent")
    one.counts.phalanges[1].last_ns = time.time_ns() + 10**12
    for expected in (None, []):
        batches = len(one.batches)
        wait_until(lambda: len(one.batches) > batches + 3, "more polls")  # noqa: B023
        assert sent_to(one) == expected or expected is None
    one.opened[-1].shutdown()
    wait_until(lambda: one.status.reconnects == 1, "the bus again")
    assert sent_to(one) == ["064#0B", "065#0B"]


def test_load_cells_are_synchronized_and_then_stopped(
    line: Callable[..., Line],
) -> None:
    commands = Commands((), parse_frames(["064#0C"]), parse_frames(["181#R", "182#R"]), 0.01)
    one = line(commands=commands)
    received: list[str] = []
    wait_until(lambda: received.extend(sent_to(one)) or len(received) > 5, "six frames")  # type: ignore[func-returns-value]
    assert set(received) == {"181#", "182#"}
    assert one.stop()
    assert sent_to(one)[-1] == "064#0C"
    time.sleep(0.05)
    assert sent_to(one) == [], "five periods later"


def test_frames_that_cannot_be_sent_are_logged_once_and_reading_continues(
    line: Callable[..., Line], monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts: list[can.Message] = []

    def refuse(bus: can.BusABC, frame: can.Message, timeout: float | None = None) -> None:
        attempts.append(frame)
        raise can.CanOperationError("transmit buffer full")

    monkeypatch.setattr(driver, "_POLL_PERIOD_S", 0.0)
    monkeypatch.setattr(driver, "SILENCE_S", 0.0)
    one = line(commands=Commands(start=parse_frames(["064#0B"])))
    send = one.sender.send
    monkeypatch.setattr(VirtualBus, "send", refuse)
    wait_until(lambda: len(attempts) > 3, "attempts")
    assert one.log == ["CAN bus: frames could not be sent: transmit buffer full"]
    monkeypatch.undo()
    send(can.Message(arbitration_id=7, is_extended_id=False))
    wait_until(lambda: 7 in one.received, "a frame")
    assert one.status.state == OPEN


@pytest.mark.parametrize(
    ("text", "identifier", "data", "kind"),
    [
        ("064#0B", 0x64, "0b", "is_rx"),
        ("18FF1021#", 0x18FF1021, "", "is_extended_id"),
        ("00000064#0b0C", 0x64, "0b0c", "is_extended_id"),
        ("181#R", 0x181, "", "is_remote_frame"),
        ("064##1" + 12 * "0B", 0x64, 12 * "0b", "bitrate_switch"),
    ],
)
def test_frames_are_written_as_candump_prints_them(text: str, identifier: int, data: str, kind: str) -> None:
    (frame,) = parse_frames([text])
    assert (frame.arbitration_id, frame.data.hex()) == (identifier, data)
    assert getattr(frame, kind)
    assert frame.is_extended_id == (len(text.partition("#")[0]) == 8)


@pytest.mark.parametrize(
    "text", ["", "064", "64#0B", "064#0", "800#", "20000000#", "064#" + 9 * "00", "064#0B 1", "x"]
)
def test_other_texts_are_no_frames(text: str) -> None:
    with pytest.raises(CanError, match="as candump prints it, such as 064#0B"):
        parse_frames([text])


def test_bugs_in_the_receiver_do_not_end_the_thread(line: Callable[..., Line]) -> None:
    one = line()
    one.mistakes.append("a mistake")
    one.send(1)
    wait_until(lambda: one.status.reconnects == 1, "the bus to be opened again")
    assert "a mistake" in one.log[0]
    one.send(2)
    one.wait_for(2)


def test_a_failing_close_is_reported(line: Callable[..., Line]) -> None:
    one = line()
    bus, closed = one.opened[-1], one.opened[-1].shutdown

    def shutdown() -> None:
        closed()
        raise AttributeError("no handle")  # interfaces raise what they like

    bus.shutdown = shutdown  # type: ignore[method-assign]
    closed()  # as if the adapter were gone
    wait_until(lambda: one.status.reconnects == 1, "the bus to be opened again")
    assert "no handle" in one.log[1]
    bus.shutdown = closed  # type: ignore[method-assign]
    one.send(3)
    one.wait_for(3)


@pytest.mark.parametrize("state", ["reading", "waiting to open again"])
def test_stop_waits_for_a_short_read_at_most(
    line: Callable[..., Line], state: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits_s: list[float] = []
    receive = VirtualBus.recv
    monkeypatch.setattr(
        VirtualBus, "recv", lambda bus, wait_s: waits_s.append(wait_s) or receive(bus, wait_s)
    )
    monkeypatch.setattr(driver, "RETRY_S", 1000.0)
    one = line()
    if state != "reading":
        one.up = False
        one.opened[-1].shutdown()
        wait_until(lambda: one.status.state == WAITING, "the failure")
    assert one.stop(timeout_s=PATIENCE_S)
    assert max(waits_s) <= 0.1
    assert one.status.state == CLOSED
    assert "can-reader" not in [thread.name for thread in threading.enumerate()]
    with pytest.raises(can.CanError):
        one.opened[-1].recv(0)


def test_traffic_is_foreign_only_while_nothing_is_delivered(monkeypatch: pytest.MonkeyPatch) -> None:
    totals = iter(range(0, 1000, 10))
    monkeypatch.setattr(driver, "link_of", lambda bus: Link(True, 16, next(totals), ""))
    one = Line("foreign")
    bus, frame = one.bus_of_its_own(), can.Message(arbitration_id=1)
    found = []
    for delivered in ([], [frame], [frame], [], [], [frame]):
        one._update_status(delivered)
        one._poll(bus)
        found.append(one.status.foreign)
    assert found == [0, 0, 0, 10, 20, 0]
    bus.shutdown()
    one.close()


def test_a_frame_of_a_sender_with_its_own_clock_was_received_after_the_bus_was_last_found_empty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 1000.0
    frame = can.Message(timestamp=3.0)

    class Bus:
        """A bus that stays empty for 0.1 s; then a frame waits, and is read 0.05 s later."""

        answers: ClassVar[list[can.Message | None]] = [None, frame]

        def recv(self, wait_s: float) -> can.Message | None:
            nonlocal now_s
            now_s += wait_s
            return self.answers.pop(0)

    monkeypatch.setattr(driver.time, "time", lambda: now_s)
    one = Line("own clock")
    one.status.clock = SenderClock()
    assert one._receive(Bus(), 0.1) is None  # type: ignore[arg-type]
    now_s += 0.05
    assert one._receive(Bus(), 0.0) is frame  # type: ignore[arg-type]
    one.close()
    assert frame.timestamp == pytest.approx(1000.1)
