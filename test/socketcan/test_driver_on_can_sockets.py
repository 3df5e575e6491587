"""The driver on CAN sockets of a kernel: ``make test-socketcan``.

Interfaces are set down and deleted, so this runs only in the kernel of ``test/socketcan/in_can_kernel``.
"""

import fcntl
import os
import pty
import re
import socket
import struct
import subprocess
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest
from support.load_cells import cycle, number_of, protocol
from support.waiting import wait_until

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.assembler import Cycle
from tactile_localizer.io.can.bus import BusSettings
from tactile_localizer.io.can.commands import Commands
from tactile_localizer.io.can.driver import OPEN, WAITING, LoadCellDriver
from tactile_localizer.io.can.error_frames import BUS_OFF, ERROR_ACTIVE, ERROR_PASSIVE, ERROR_WARNING
from tactile_localizer.io.can.protocol import FrameKind

pytestmark = pytest.mark.skipif("IN_CAN_KERNEL" not in os.environ, reason="`make test-socketcan` runs it")

PERIOD_S = 1 / 40
"""Period of the load cells, s; a user-mode kernel is slow."""

RETURN_S = 0.2
"""Longest time from an interface that works again to strain, s."""


def ip(command: str) -> None:
    subprocess.run(["ip", *command.split()], check=True)


class Bench:
    """A driver on an interface, and load cells that send on it whenever it is up."""

    def __init__(
        self,
        channel: str = "vcan0",
        dbc: str = "loadcells.dbc",
        receive_buffer: int = 1 << 20,
        max_age_s: float = 5.0,  # no machine is so busy
        commands: Commands | None = None,
    ) -> None:
        self.hand = protocol(dbc=dbc)
        self.channel, self.number = channel, 0
        self.cycles: list[Cycle] = []
        self.log: list[str] = []
        self.driver = LoadCellDriver(
            self.hand,
            BusSettings("socketcan", channel, receive_buffer=receive_buffer, commands=commands or Commands()),
            self.cycles.append,
            period_s=1.0,  # on a busy machine the sender pauses between the frames of a cycle
            max_age_s=max_age_s,
            log=self.log.append,
            note=self.log.append,
        )
        self.sends = threading.Event()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._send_periodically, daemon=True)
        self._thread.start()

    @property
    def counts(self) -> dict[FrameKind, int]:
        return dict(zip(FrameKind, self.driver.counts.frames, strict=True))

    def send(self, bus: can.BusABC, count: int = 1) -> None:
        for _ in range(count):
            for frame in cycle(self.hand, self.number):
                bus.send(frame)
            self.number += 1

    def _send_periodically(self) -> None:
        while not self._stop.wait(PERIOD_S):
            if not self.sends.is_set():
                continue
            try:
                with can.Bus(interface="socketcan", channel=self.channel, fd=self.hand.is_fd) as bus:
                    while self.sends.is_set() and not self._stop.wait(PERIOD_S):
                        self.send(bus)
            except (OSError, can.CanError):
                continue  # the interface is down, or gone

    def start(self) -> None:
        self.driver.start()
        self.sends.set()
        self.wait_for_strain()

    def wait_for_strain(self) -> float:
        """Wait for the next cycle; returns how long that took, s."""
        begin_s, count = time.monotonic(), len(self.cycles)
        wait_until(lambda: len(self.cycles) > count, "strain")
        return time.monotonic() - begin_s

    def statuses(self) -> list[tuple[bytes, str]]:
        """Level and message of the bus and the phalanges in the diagnostics."""
        from tactile_localizer.ros.diagnostics.driver import DriverDiagnostics

        publisher = SimpleNamespace(status=lambda name, level, message, values: (level, message))
        return DriverDiagnostics(self.driver, publisher, 0.5).statuses()

    def bus_status(self) -> tuple[bytes, str]:
        return self.statuses()[0]

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        assert self.driver.stop()


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(*args: Any, **kwargs: Any) -> Bench:
        made.append(Bench(*args, **kwargs))
        return made[-1]

    add_interface()
    yield make
    for one in made:
        one.close()
    subprocess.run(["ip", "link", "del", "vcan0"], check=False, capture_output=True)


def add_interface() -> None:
    ip("link add vcan0 type vcan")
    ip("link set vcan0 up")


@pytest.fixture
def sender(bench: Callable[..., Bench]) -> Iterator[can.BusABC]:
    with can.Bus(interface="socketcan", channel="vcan0", fd=True) as bus:
        yield bus


def test_stamps_are_the_kernels_receive_times(bench: Callable[..., Bench]) -> None:
    one = bench()
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as other:
        other.setsockopt(socket.SOL_SOCKET, 35, 1)  # SO_TIMESTAMPNS
        other.bind(("vcan0",))
        one.start()
        wait_until(lambda: len(one.cycles) > 10, "ten cycles")
        received_ns = set()
        for _ in range(40):
            _, ((_, _, data),), *_ = other.recvmsg(16, 100)
            seconds, nanoseconds = struct.unpack("qq", data)
            received_ns.add(seconds * 10**9 + nanoseconds)
    for made in one.cycles[:8]:
        assert min(abs(made.stamp_ns - stamp_ns) for stamp_ns in received_ns) < 2000
        assert not made.status.any()


def test_foreign_frames_are_filtered_by_the_kernel_and_named(
    bench: Callable[..., Bench], sender: can.BusABC
) -> None:
    one = bench()
    one.driver.start()
    wait_until(lambda: one.driver.status.state == OPEN, "the bus")
    assert one.bus_status()[1] == "open, idle"
    for n in range(100):
        sender.send(can.Message(arbitration_id=0x700 + n, is_extended_id=False, data=bytes(8)))
    wait_until(lambda: one.driver.status.foreign == 100, "the frames on the interface")
    assert one.bus_status() == (b"\1", "idle: 100 frames on vcan0, none with an identifier of the DBC")
    one.sends.set()
    one.wait_for_strain()
    assert one.bus_status() == (b"\0", "open")
    assert not any(count for kind, count in one.counts.items() if kind != FrameKind.DATA)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        ({"is_extended_id": True, "data": bytes(8)}, "an identifier of 29 bits instead of 11"),
        ({"is_fd": True, "data": bytes(12)}, "12 bytes instead of 8"),
    ],
)
def test_frames_that_resemble_a_message_are_named(
    bench: Callable[..., Bench], sender: can.BusABC, frame: dict[str, Any], reason: str
) -> None:
    one = bench()
    one.driver.start()
    wait_until(lambda: one.driver.status.state == OPEN, "the bus")
    sender.send(can.Message(**{"arbitration_id": 0x102, "is_extended_id": False, **frame}))
    wait_until(lambda: sum(one.counts.values()), "the frame")
    assert one.statuses()[1] == (b"\2", f"0x102 index_a: {reason}")


def test_can_fd_frames_of_a_classic_layout_are_read(bench: Callable[..., Bench], sender: can.BusABC) -> None:
    one = bench()
    one.driver.start()
    wait_until(lambda: one.driver.status.state == OPEN, "the bus")
    frames = [frame for number in range(8) for frame in cycle(one.hand, number)]
    for frame in frames:
        frame.is_fd = frame.bitrate_switch = True
        sender.send(frame)
    wait_until(lambda: one.counts[FrameKind.DATA] == len(frames), "all frames")
    # Where cycles begin is open at first, and frames that are sent without a pause do not show it.
    wait_until(lambda: sum(not made.status.any() for made in one.cycles) >= 5, "strain")


def test_can_fd_needs_an_interface_with_it(bench: Callable[..., Bench]) -> None:
    one = bench(dbc="loadcells_fd.dbc")
    one.start()
    wait_until(lambda: len(one.cycles) > 5, "five cycles")
    assert not any(made.status.any() for made in one.cycles[1:])
    assert one.driver.stop()
    ip("link set vcan0 down")
    ip("link set vcan0 mtu 16")
    with pytest.raises(CanError, match="vcan0: expected an MTU of 72 for CAN FD, found 16"):
        one.driver.start()


@pytest.mark.parametrize(("cause", "reason"), [("down", "Network is down"), ("gone", "No such device")])
def test_strain_comes_and_returns_with_the_interface(
    bench: Callable[..., Bench], cause: str, reason: str
) -> None:
    one = bench()
    delays_s = []
    for attempt in range(1, 5):  # on a busy machine some of them are slow
        ip("link set vcan0 down" if cause == "down" else "link del vcan0")
        if attempt == 1:  # it is not there yet
            one.driver.start()
            one.sends.set()
        wait_until(lambda: one.driver.status.state == WAITING, "the failure")
        wait_until(lambda: reason in one.driver.status.error, reason)
        assert reason in one.bus_status()[1]
        if attempt == 1 and cause == "gone":
            failed_s = one.driver.status.error_s
            wait_until(lambda: one.driver.status.error_s > failed_s + 0.3, "more attempts")  # noqa: B023
            assert len(one.log) == 1, "not a line for each of them"
        ip("link set vcan0 up") if cause == "down" else add_interface()
        delays_s.append(one.wait_for_strain())
        assert one.driver.status.state == OPEN
        assert one.driver.status.reconnects == attempt
        assert one.log[-1] == "CAN bus: open"
    assert min(delays_s) < RETURN_S
    # What was on its way when the interface went down can be lost, but nothing of the time without it.
    assert sum(cell.drops for cell in one.driver.counts.phalanges) <= 4 * len(delays_s)
    print(f"strain {', '.join(f'{one:.3f}' for one in delays_s)} s after the interface is back")


def test_the_newest_frames_are_used_after_a_delay(bench: Callable[..., Bench], sender: can.BusABC) -> None:
    one = bench(receive_buffer=20_480, max_age_s=0.2)
    may_read, waits = threading.Event(), threading.Event()
    may_read.set()
    deliver = one.driver._deliver

    def delayed(messages: list[can.Message]) -> float:
        if not may_read.is_set():
            waits.set()
            may_read.wait()
        return deliver(messages)

    one.driver._deliver = delayed  # type: ignore[method-assign]
    one.driver.start()
    wait_until(lambda: one.send(sender) or one.counts[FrameKind.DATA], "frames that are not late")
    may_read.clear()
    wait_until(waits.is_set, "the thread to wait")
    one.send(sender, 100)
    sent_s = time.monotonic()
    wait_until(lambda: time.monotonic() > sent_s + 1.0, "the frames to be 1 s old")
    may_read.set()
    wait_until(lambda: one.counts[FrameKind.LATE] > 0, "the late frames")
    wait_until(lambda: one.driver.status.queue_drops > 0, "the drops, which are polled")
    level, message = one.bus_status()
    assert level == b"\1"
    assert re.search(
        r"frames dropped, receive queue full; read [1-9]\d*\.\d s late: \d+ frames disc", message
    )
    oldest, before = one.number, len(one.cycles)
    one.sends.set()
    one.wait_for_strain()
    one.wait_for_strain()
    assert all(number_of(0, made.strain[:8]) >= oldest for made in one.cycles[before:] if not made.status[0])
    one.sends.clear()
    wait_until(
        lambda: sum(one.counts.values()) + one.driver.status.queue_drops == 4 * one.number,
        "all frames counted",
    )


def test_a_receive_buffer_that_is_too_small_is_reported(bench: Callable[..., Bench]) -> None:
    one = bench()
    os.seteuid(65534)  # without CAP_NET_ADMIN
    try:
        one.driver.start()
    finally:
        os.seteuid(0)
    wait_until(lambda: one.log, "a line about the bus")
    limit = one.driver.status.queue.limit
    assert f"receive buffer of {limit} instead of 1048576 bytes (net.core.rmem_max)" in one.log[0]


class Adapter:
    """A serial CAN adapter (slcan) on a pseudo terminal: an interface can0 with states and error frames."""

    def plug_in(self) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.master)
        tty.setraw(self.slave)
        threading.Thread(target=self._read, daemon=True).start()  # the kernel waits until it is read
        fcntl.ioctl(self.slave, 0x5423, struct.pack("i", 17))  # TIOCSETD, N_SLCAN
        wait_until(lambda: Path("/sys/class/net/can0").exists(), "can0")
        ip("link set can0 up type can bitrate 1000000")

    def _read(self) -> None:
        try:
            while os.read(self.master, 1000):
                pass
        except OSError:
            pass  # unplugged

    def put(self, text: str) -> None:
        os.write(self.master, f"{text}\r".encode())

    def send(self, one: Bench, count: int = 1) -> None:
        for _ in range(count):
            for frame in cycle(one.hand, one.number):
                self.put(f"t{frame.arbitration_id:03X}8{bytes(frame.data).hex().upper()}")
            one.number += 1
            time.sleep(PERIOD_S)

    def unplug(self) -> None:
        os.close(self.slave)
        os.close(self.master)
        wait_until(lambda: not Path("/sys/class/net/can0").exists(), "the end of can0")


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    one = Adapter()
    one.plug_in()
    yield one
    one.unplug()


def test_states_of_the_controller_are_values(bench: Callable[..., Bench], adapter: Adapter) -> None:
    one = bench("can0")
    adapter.put("sp130000")  # error passive, as with a wrong bit rate, before the driver starts
    one.driver.start()

    def until(state: str, level: bytes, message: str) -> None:
        wait_until(lambda: one.driver.status.controller == state, state)
        link = one.driver.status.link
        wait_until(lambda: one.driver.status.link is not link, "the answer of the kernel")
        assert one.driver.status.controller == state
        found = one.bus_status()
        assert found[0] == level
        assert message in found[1]

    until(ERROR_PASSIVE, b"\2", "error passive: wrong bit rate")
    adapter.put("sw100000")
    until(ERROR_WARNING, b"\1", "error warning")
    adapter.put("sa000000")
    until(ERROR_ACTIVE, b"\0", "open")
    assert not one.driver.status.errors
    adapter.put("sb000255")
    until(BUS_OFF, b"\2", "bus off: ")
    adapter.send(one, 4)  # restarted, as by restart-ms
    wait_until(lambda: one.driver.status.controller == ERROR_ACTIVE and len(one.cycles) > 1, "strain")
    lines = ["error passive", "error warning", "error active", "bus off", "error active"]
    assert [line for line in one.log if "controller" in line] == [f"CAN controller: {one}" for one in lines]
