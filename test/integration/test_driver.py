"""The installed driver between a simulated bus and DDS, with faults."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import can
import pytest
from support.driver import Listener, Sender

pytestmark = pytest.mark.ros


def test_each_cycle_is_one_message_with_its_receive_time(
    driver_process: Callable[..., Any], can_bus: can.BusABC, probe: Any
) -> None:
    driver_process()
    listener, hand = Listener(probe), Sender(can_bus, probe)
    listener.listen(hand)
    begin_ns = time.time_ns()
    numbers = hand.send(300)
    probe.until(lambda: len(listener.strains) >= 300, "300 strain vectors")
    assert listener.numbers() == [{n} for n in numbers]
    assert [list(message.sequence) for message in listener.strains] == [[n, n] for n in numbers]
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in listener.strains]
    assert begin_ns - 10**6 < stamps[0] < stamps[-1] < time.time_ns()
    assert stamps == sorted(stamps)
    assert list(listener.strains[0].phalanges) == ["index", "middle"]


def test_losses_are_counted_exactly(
    driver_process: Callable[..., Any], can_bus: can.BusABC, probe: Any
) -> None:
    driver_process()
    listener, hand = Listener(probe), Sender(can_bus, probe)
    listener.listen(hand)
    hand.send(400, loss=0.05)
    hand.wait(listener)
    assert listener.drops() == hand.lost > 40

    hand.send(40, silent=True)
    last = hand.send(40)[-1]
    hand.wait(listener)
    assert listener.drops() == hand.lost
    probe.until(lambda: listener.strains[-1].sequence[0] == last, "the last strain vector")
    assert list(listener.strains[-1].status) == [0, 0]
    listener.numbers()  # fails on a sample of frames of two


def test_reconnect_and_bus_off_are_survived(
    driver_process: Callable[..., Any], can_bus: can.BusABC, probe: Any
) -> None:
    from std_srvs.srv import Trigger

    node = driver_process()
    listener, hand = Listener(probe), Sender(can_bus, probe)
    listener.listen(hand)
    sent = list(hand.send(10))
    hand.wait(listener)
    assert probe.call(Trigger, "driver/reconnect").success
    probe.until(listener.reconnects(1), "the reopened bus")
    hand.pause(5)
    sent += hand.send(15)
    can_bus.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
    probe.until(lambda: listener.counted("CAN bus")["controller"] == "bus off", "bus-off")
    hand.pause(10)
    sent += hand.send(15)
    hand.wait(listener)
    probe.until(lambda: listener.counted("CAN bus")["controller"] == "error active", "the controller")
    assert listener.drops() == 0  # samples sent while the bus is closed are not counted
    assert listener.counted("CAN bus")["frames_error"] == "1"
    assert all(len(numbers) == 1 for numbers in listener.numbers())
    assert {n for numbers in listener.numbers() for n in numbers} >= set(sent)
    assert node.running
    assert "Traceback" not in node.output


def test_simulated_time_stamps_with_the_node_clock(
    driver_process: Callable[..., Any], can_bus: can.BusABC, probe: Any
) -> None:
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    driver_process(use_sim_time=True)
    clock = probe.publisher(Clock, "/clock")
    listener, hand = Listener(probe), Sender(can_bus, probe)  # diagnostics continue while time stands still
    listener.listen(hand)
    assert listener.strains == []

    def stamped() -> bool:
        clock.publish(Clock(clock=Time(sec=17, nanosec=5)))
        hand.send(1)
        return bool(listener.strains) and listener.strains[-1].header.stamp.sec == 17

    probe.until(stamped, "a stamp of simulated time")
    assert listener.strains[-1].header.stamp.nanosec == 5
