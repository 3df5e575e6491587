"""The installed driver between a simulated bus and DDS: what is sent arrives, through every fault."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import can
import numpy as np
import pytest
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

    def numbers(self) -> list[set[int]]:
        """Which samples each strain vector so far is of; fails on a voltage that was not sent."""
        return [
            {
                number_of(p, np.array(message.strain[8 * p : 8 * p + 8]))
                for p in range(2)
                if not message.status[p] & message.MISSING
            }
            for message in self.strains
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


def test_loss_garbage_bus_off_reconnects_and_a_silent_phalanx_leave_it_up_with_counts_right_to_the_frame(
    driver: Callable[..., Any], bus: can.BusABC, probe: Any
) -> None:
    from std_srvs.srv import Trigger

    node = driver()
    listener = Listener(probe)
    listener.matched()
    rng = np.random.default_rng(0)
    sent = lost = garbage = 0

    def send(numbers: range, loss: float = 0.0, silent: bool = False) -> None:
        nonlocal sent, lost, garbage
        for n in numbers:
            for i, frame in enumerate(cycle(HAND, n)):
                if (silent and i >= 2) or (rng.random() < loss and n not in (numbers[0], numbers[-1])):
                    lost += 1
                    continue
                bus.send(frame)
                sent += 1
                if loss and rng.random() < 0.1:
                    bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False, data=rng.bytes(8)))
                    garbage += 1
            probe.executor.spin_once(timeout_sec=0.002)

    def arrived() -> bool:
        counted = listener.counted("CAN bus")
        return (counted.get("frames_data"), counted.get("frames_unknown_id")) == (str(sent), str(garbage))

    def drops() -> int:
        return sum(int(listener.counted(phalanx)["drops"]) for phalanx in ("index", "middle"))

    send(range(400), loss=0.05)
    probe.until(arrived, "all frames counted")
    assert drops() == lost > 40

    send(range(400, 440), silent=True)
    send(range(440, 480))
    probe.until(arrived, "all frames counted")
    assert drops() == lost
    assert listener.counted("middle")["gaps"] >= "40"
    assert list(listener.strains[-1].status) == [0, 0]

    assert probe.call(Trigger, "driver_node/reconnect").success
    probe.until(lambda: listener.counted("CAN bus")["reconnects"] == "1", "the bus opened again")
    send(range(485, 500))
    bus.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
    probe.until(
        lambda: listener.counted("CAN bus")["reconnects"] == "2", "the bus opened again after bus-off"
    )
    assert listener.counted("CAN bus")["state"] == "bus off"
    send(range(510, 520))
    probe.until(arrived, "all frames counted")
    probe.until(lambda: listener.counted("CAN bus")["state"] == "open", "the bus to be well again")
    assert drops() == lost  # what happens while a bus is closed nobody can know
    assert listener.counted("CAN bus")["frames_error"] == "1"

    assert all(len(numbers) <= 1 for numbers in listener.numbers())
    assert listener.numbers()[-1] == {519}
    assert node.running
    assert "Traceback" not in node.output
