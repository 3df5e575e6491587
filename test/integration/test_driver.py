"""The installed driver between a simulated bus and DDS: what is sent arrives, through every fault."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.udp_multicast.utils import pack_message
from support.load_cells import cycle, number_of, protocol

pytestmark = pytest.mark.ros

HAND = protocol()


@pytest.fixture
def bus(simulated_can: dict[str, Any]) -> Iterator[can.BusABC]:
    one = can.Bus(**simulated_can, hop_limit=0)
    yield one
    one.shutdown()


@pytest.fixture
def driver(
    node_process: Callable[..., Any], simulated_can: dict[str, Any], tmp_path: Any
) -> Callable[..., Any]:
    parameters = {
        "interface": simulated_can["interface"],
        "channel": simulated_can["channel"],
        "bus_options": [f"port={simulated_can['port']}"],
        "tare_file": str(tmp_path / "tare.yaml"),
        "cycle_timeout_s": 0.05,
        "reconnect_delay_s": 0.02,
    }
    return lambda **more: node_process("driver_node", parameters={**parameters, **more})


class Listener:
    """What the driver publishes."""

    def __init__(self, probe: Any) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        from tactile_localizer.msg import StrainVectors

        best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.probe = probe
        self.strains = probe.listen(StrainVectors, "strain", best_effort)
        self.diagnostics = probe.listen(DiagnosticArray, "/diagnostics")

    def matched(self) -> None:
        """Wait until the driver is up and heard."""
        self.probe.until(
            lambda: self.diagnostics and self.probe.node.count_publishers("strain"), "the driver"
        )

    def counted(self, what: str) -> dict[str, str]:
        statuses = self.diagnostics[-1].status if self.diagnostics else []
        return {
            pair.key: pair.value
            for status in statuses
            if status.name == f"driver_node: {what}"
            for pair in status.values
        }

    def numbers(self, first: int = 0) -> list[set[int]]:
        """Which samples each strain vector from the ``first`` on is of; fails on voltages not sent."""
        return [
            {
                number_of(p, np.array(message.strain[8 * p : 8 * p + 8]))
                for p in range(2)
                if not message.status[p] & message.MISSING
            }
            for message in self.strains[first:]
        ]


def test_every_cycle_sent_is_one_message_with_the_time_of_its_receipt(
    driver: Callable[..., Any], bus: can.BusABC, probe: Any
) -> None:
    driver()
    listener = Listener(probe)
    listener.matched()
    begin_ns = time.time_ns()
    for n in range(300):
        for frame in cycle(HAND, n):
            bus.send(frame)
        probe.executor.spin_once(timeout_sec=0.002)
    probe.until(lambda: len(listener.strains) >= 300, "300 strain vectors")
    assert listener.numbers() == [{n} for n in range(300)]
    assert [list(message.sequence) for message in listener.strains] == [[n, n] for n in range(300)]
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in listener.strains]
    assert begin_ns - 10**6 < stamps[0] < stamps[-1] < time.time_ns()
    assert stamps == sorted(stamps)
    assert list(listener.strains[0].phalanges) == ["index", "middle"]


class Sender:
    """Sends cycles and keeps count of what it sent, left out and added."""

    def __init__(self, bus: can.BusABC, probe: Any) -> None:
        self.bus, self.probe = bus, probe
        self.rng = np.random.default_rng(0)
        self.sent = self.lost = self.garbage = 0

    def send(self, numbers: range, loss: float = 0.0, silent: bool = False) -> None:
        for n in numbers:
            for i, frame in enumerate(cycle(HAND, n)):
                at_an_end = n in (numbers[0], numbers[-1])
                if (silent and i >= 2) or (self.rng.random() < loss and not at_an_end):
                    self.lost += 1
                    continue
                self.bus.send(frame)
                self.sent += 1
                if loss and self.rng.random() < 0.1:
                    data = self.rng.bytes(8)
                    self.bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False, data=data))
                    self.garbage += 1
            self.probe.executor.spin_once(timeout_sec=0.002)

    def wait(self, listener: Listener) -> None:
        """Wait until the driver has told of every frame sent."""
        expected = (str(self.sent), str(self.garbage))

        def counted() -> bool:
            told = listener.counted("CAN bus")
            return (told.get("frames_data"), told.get("frames_unknown_id")) == expected

        self.probe.until(counted, "all frames counted")


def drops(listener: Listener) -> int:
    return sum(int(listener.counted(phalanx)["drops"]) for phalanx in ("index", "middle"))


def test_loss_garbage_and_a_silent_phalanx_are_counted_to_the_frame_and_mix_nothing(
    driver: Callable[..., Any], bus: can.BusABC, probe: Any
) -> None:
    driver()
    listener, hand = Listener(probe), Sender(bus, probe)
    listener.matched()
    hand.send(range(400), loss=0.05)
    hand.wait(listener)
    assert drops(listener) == hand.lost > 40

    hand.send(range(400, 440), silent=True)
    hand.send(range(440, 480))
    hand.wait(listener)
    assert drops(listener) == hand.lost
    assert int(listener.counted("middle")["gaps"]) >= 40
    probe.until(lambda: listener.strains[-1].sequence[0] == 479, "the last strain vector")
    assert list(listener.strains[-1].status) == [0, 0]
    assert all(len(numbers) <= 1 for numbers in listener.numbers())


def test_a_reconnect_and_bus_off_are_survived_and_told(
    driver: Callable[..., Any], bus: can.BusABC, probe: Any
) -> None:
    from std_srvs.srv import Trigger

    node = driver()
    listener, hand = Listener(probe), Sender(bus, probe)
    listener.matched()

    def reconnects(count: int) -> Callable[[], bool]:
        return lambda: listener.counted("CAN bus")["reconnects"] == str(count)

    hand.send(range(10))
    hand.wait(listener)
    assert probe.call(Trigger, "driver_node/reconnect").success
    probe.until(reconnects(1), "the bus opened again")
    hand.send(range(15, 30))
    bus.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
    probe.until(reconnects(2), "the bus opened again after bus-off")
    assert listener.counted("CAN bus")["state"] == "bus off"
    hand.send(range(40, 50))
    hand.wait(listener)
    probe.until(lambda: listener.counted("CAN bus")["state"] == "open", "the bus to be well again")
    assert drops(listener) == 0  # what happens while a bus is closed nobody can know
    assert listener.counted("CAN bus")["frames_error"] == "1"
    assert listener.numbers() == [{n} for n in (*range(10), *range(15, 30), *range(40, 50))]
    assert node.running
    assert "Traceback" not in node.output


class Fuzz:
    """Random frames, packed as the simulated bus sends them, and how many of each kind they are."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(1)
        self.known = HAND.layout.key.tolist()
        self.expected = dict.fromkeys(("unknown_id", "wrong_length", "remote", "error", "looks_good"), 0)
        self.unreadable = 0

    def datagrams(self, count: int) -> Iterator[bytes]:
        dice = self.rng.random((count, 2)).tolist()
        lengths = self.rng.choice([8, 0, 3, 7, 12, 64], count, p=[0.5, 0.1, 0.1, 0.1, 0.1, 0.1]).tolist()
        identifiers = self.rng.integers(0x200, 0x7FF, count).tolist()
        noise = self.rng.bytes(64 * count)
        for i in range(count):
            if dice[i][0] < 0.01:
                self.unreadable += 1
                yield b"\xc1" + noise[64 * i : 64 * i + 20]  # 0xC1 begins nothing in msgpack
                continue
            is_known = dice[i][0] < 0.5
            remote, error = dice[i][1] < 0.1, dice[i][1] > 0.9
            length = 0 if remote else min(lengths[i], 8) if error else lengths[i]
            yield self._pack(is_known, remote, error, length, identifiers[i], noise[64 * i : 64 * i + length])

    def _pack(self, is_known: bool, remote: bool, error: bool, length: int, other: int, data: bytes) -> bytes:
        if error:
            kind, identifier = "error", 0x04  # bus-off would close the bus, with what waits in it
        else:
            kind, identifier = "looks_good", self.known[other % 4] if is_known else other
            kind = "remote" if remote else "unknown_id" if not is_known else kind
            kind = "wrong_length" if kind == "looks_good" and length != 8 else kind
        self.expected[kind] += 1
        frame = can.Message(
            arbitration_id=identifier,
            is_extended_id=False,
            is_remote_frame=remote,
            is_error_frame=error,
            is_fd=length > 8,
            data=data,
        )
        return pack_message(frame)


def waiting_bytes(port: int) -> int:
    """Bytes in the fullest receive queue of a UDP port."""
    lines = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    return max(int(f[4].split(":")[1], 16) for f in lines if int(f[1].split(":")[1], 16) == port)


@pytest.mark.slow
def test_a_million_random_frames_leave_it_up_with_counts_right_to_the_frame(
    driver: Callable[..., Any], bus: can.BusABC, probe: Any, simulated_can: dict[str, Any]
) -> None:
    node = driver(receive_buffer=1 << 22)
    listener, hand, fuzz = Listener(probe), Sender(bus, probe), Fuzz()
    listener.matched()
    for _ in range(1000):
        for datagram in fuzz.datagrams(1000):
            bus._multicast.send(datagram)  # type: ignore[attr-defined]
        while waiting_bytes(simulated_can["port"]) > 1 << 20:
            probe.executor.spin_once(timeout_sec=0.001)
    assert sum(fuzz.expected.values()) + fuzz.unreadable == 1_000_000

    def counted() -> bool:
        told = listener.counted("CAN bus")
        looks_good = sum(int(told[f"frames_{kind}"]) for kind in ("data", "duplicate", "out_of_order"))
        others = {kind: int(told[f"frames_{kind}"]) for kind in fuzz.expected if kind != "looks_good"}
        return others | {"looks_good": looks_good} == fuzz.expected

    probe.until(counted, "a million frames counted", 60.0)
    told = listener.counted("CAN bus")
    assert (told["unreadable"], told["queue_drops"]) == (str(fuzz.unreadable), "0")
    assert (told["state"], told["reconnects"]) == ("open", "0")

    hand.send(range(100, 200))
    probe.until(lambda: listener.strains[-1].sequence[0] % 16 == 199 % 16, "good data")
    assert listener.numbers(first=len(listener.strains) - 50) == [{n} for n in range(150, 200)]
    assert node.running
    assert "Traceback" not in node.output
