"""The installed driver between a simulated bus and DDS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from support.diagnostics import status_of
from support.load_cells import cycle, number_of, protocol
from support.processes import Process, node_command

pytestmark = pytest.mark.ros

HAND = protocol()


class Bench:
    """A running driver, load cells that count the frames that they send to it, and a subscriber."""

    def __init__(self, node: Process, bus: can.BusABC, probe: Any) -> None:
        from tactile_localizer.msg import StrainVectors

        self.node, self._bus, self._probe = node, bus, probe
        self.number = 0  # of the next cycle
        self.sent = 0
        self._diagnostics = probe.diagnostics()
        self.strains: list[Any] = probe.listen(StrainVectors, "strain", probe.best_effort)
        self.until(lambda: self._diagnostics, "the driver")
        self.until(self._completed, "the driver's strain")
        self.until(lambda: self.numbers()[-1] == {self.number - 1}, "the last cycle sent")
        self.strains.clear()

    def until(self, condition: Callable[[], Any], what: str) -> None:
        self._probe.until(condition, what)

    def _completed(self) -> bool:
        """Whether a strain vector after another cycle is complete."""
        self.send(1)
        return bool(self.strains) and not any(self.strains[-1].status)

    def send(self, count: int) -> range:
        """Send cycles; returns their numbers."""
        numbers = range(self.number, self.number + count)
        for n in numbers:
            for frame in cycle(HAND, n):
                self._bus.send(frame)
                self.sent += 1
            self._probe.executor.spin_once(timeout_sec=0.002)
        self.number += count
        return numbers

    def send_bus_off(self) -> None:
        self._bus.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))

    def until_counted(self, **values: object) -> None:
        """Wait for diagnostics with these values, and until the driver has counted every frame sent."""
        wanted = {key: str(value) for key, value in {"frames_data": self.sent, **values}.items()}
        self.until(
            lambda: wanted.items() <= status_of(self._diagnostics, "driver: CAN bus")[2].items(), str(wanted)
        )

    def drops(self) -> int:
        """Number of lost frames reported by the driver."""
        names = ("driver: index", "driver: middle")
        return sum(int(status_of(self._diagnostics, name)[2]["drops"]) for name in names)

    def numbers(self) -> list[set[int]]:
        """Numbers of the samples in each strain vector; fails on voltages that were not sent."""
        return [
            {
                number_of(p, np.array(message.strain[8 * p : 8 * p + 8]))
                for p in range(2)
                if not message.status[p] & message.MISSING
            }
            for message in self.strains
        ]


@pytest.fixture
def bench(
    process: Callable[..., Process], simulated_can: dict[str, Any], probe: Any, tmp_path: Path
) -> Iterator[Callable[..., Bench]]:
    """Start an installed driver on a simulated bus; arguments are parameters."""
    parameters = {
        "interface": simulated_can["interface"],
        "channel": simulated_can["channel"],
        "bus_options": [f"port={simulated_can['port']}"],
        "tare_file": str(tmp_path / "tare.yaml"),
        "period_s": 1.0,  # on a busy machine the test can pause between two frames,
        "max_age_s": 60.0,  # or the driver before it reads them
    }
    with can.Bus(**simulated_can, hop_limit=0) as bus:
        yield lambda **more: Bench(process(node_command("driver_node", {**parameters, **more})), bus, probe)


def test_each_cycle_is_one_message_with_its_receive_time(bench: Callable[..., Bench]) -> None:
    one = bench()
    begin_ns = time.time_ns()
    numbers = range(one.number, one.number + 300)
    for _ in range(15):  # fewer at a time than a queue holds: best-effort messages that exceed it are lost
        one.send(20)
        one.until(lambda: len(one.strains) >= one.number - numbers.start, "the strain vector of each cycle")
    assert one.numbers() == [{n} for n in numbers]
    assert [list(message.sequence) for message in one.strains] == [[n, n] for n in numbers]
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in one.strains]
    assert begin_ns - 10**6 < stamps[0] < stamps[-1] < time.time_ns()
    assert stamps == sorted(stamps)
    assert list(one.strains[0].phalanges) == ["index", "middle"]


def test_a_closed_bus_and_bus_off_are_survived(bench: Callable[..., Bench], probe: Any) -> None:
    one = bench()
    sent = list(one.send(10))
    one.until_counted()
    assert probe.change("driver", "deactivate")
    one.number += 5  # as while the bus is closed
    assert probe.change("driver", "activate")
    sent += one.send(15)
    one.send_bus_off()
    one.until_counted(controller="bus off")
    one.number += 10
    sent += one.send(15)
    one.until_counted(controller="error active", frames_error=1)
    assert one.drops() == 0  # samples sent while the bus is closed are not counted
    assert {len(numbers) for numbers in one.numbers()} == {1}, one.numbers()
    assert {n for numbers in one.numbers() for n in numbers} >= set(sent)
    assert one.node.running
    assert "Traceback" not in one.node.output


def test_simulated_time_stamps_with_the_node_clock(bench: Callable[..., Bench], probe: Any) -> None:
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    one = bench(use_sim_time=True)  # diagnostics continue while time stands still
    clock = probe.publisher(Clock, "/clock")

    def stamped() -> bool:
        clock.publish(Clock(clock=Time(sec=17, nanosec=5)))
        one.send(1)
        return bool(one.strains) and one.strains[-1].header.stamp.sec == 17

    one.until(stamped, "a stamp of simulated time")
    assert one.strains[-1].header.stamp.nanosec == 5
