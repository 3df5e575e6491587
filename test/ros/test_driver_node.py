"""Parameters, services and diagnostics of the driver node."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
from support.diagnostics import status_of
from support.hand import stamp_of
from support.load_cells import cycle, number_of, protocol
from support.processes import node_command
from support.waiting import StarvedError

from tactile_localizer.msg import StrainVectors

HAND = protocol()
BAD_PARAMETERS = {
    "no such DBC": ({"dbc": "/nowhere/hand.dbc"}, "/nowhere/hand.dbc: expected a DBC file, No such file"),
    "a period out of range": ({"period_s": 5.0}, "period_s"),
    "a period that is text": ({"period_s": "long"}, "expecting type 'DOUBLE'"),
    "no phalanges": (
        {"phalanges": []},
        "parameter phalanges: expected a value such as ['index', 'middle'], got []",
    ),
}


@pytest.fixture
def parameters(valid: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return {
        **valid["driver"],
        "tare_duration_s": 0.5,  # enough for the 10 samples that a tare needs
        "period_s": 1.0,  # on a busy machine the test can pause between two frames,
        "max_age_s": 60.0,  # or the driver before it reads them
    }


_PAUSE_S = 0.002
"""Pause between two cycles. Within a cycle, load cells make none that is nearly as long."""


class Hand:
    """Load cells that send a cycle whenever a condition is evaluated, and what the driver makes of it."""

    def __init__(self, simulated_can: dict[str, Any], probe: Any) -> None:
        self.bus, self._probe = can.Bus(**simulated_can, hop_limit=0), probe
        self.number = 0  # of the next cycle
        self._longest_s = 0.0  # that the frames of a cycle took
        self.rests = False  # with the same voltages in each sample, instead of distinguishable ones
        self.strains: list[Any] = probe.listen(StrainVectors, "strain", probe.best_effort)
        self.reports: list[Any] = probe.diagnostics()

    def send(self) -> None:
        frames = cycle(HAND, self.number)
        if self.rests:
            frames = [f for p in range(2) for f in HAND.encode(p, np.full(8, 0.5 + p), self.number)]
        time.sleep(_PAUSE_S)
        begin_s = time.monotonic()
        for frame in frames:
            self.bus.send(frame)
        self._longest_s = max(self._longest_s, time.monotonic() - begin_s)
        self.number += 1

    def send_cycles(self, count: int) -> range:
        """Send cycles, no more at a time than a queue holds; returns their numbers."""
        first = self.number
        for _ in range(count):
            self.send()
            self._probe.executor.spin_once(timeout_sec=0.0)
        return range(first, self.number)

    def sending(self, condition: Callable[[], Any], what: str) -> None:
        """Send until ``condition`` is true."""
        self._probe.until(lambda: self.send() or condition(), what)

    def wait_for_strain(self, expected: list[float], what: str) -> None:
        """Send until the newest strain is ``expected``, V."""
        strains = self.strains
        self.sending(lambda: strains and np.allclose(strains[-1].strain, expected, atol=0.001), what)

    def call(self, service: str) -> Any:
        """The response of a service of the driver while the hand sends."""
        client = self._probe.node.create_client(Trigger, f"tactile_driver/{service}")
        self._probe.until(client.service_is_ready, service)
        self._probe.known_to("tactile_driver")
        future = client.call_async(Trigger.Request())
        self.sending(future.done, f"an answer of {service}")
        return future.result()

    def start(self) -> None:
        """Send until the driver has published the last cycle; then count and gather from now on."""
        self._probe.until(lambda: self.reports, "the driver")
        self.sending(lambda: self.strains and not any(self.strains[-1].status), "whole strain vectors")
        self._probe.until(lambda: self.numbers()[-1] == {self.number - 1}, "the last cycle sent")
        self.strains.clear()

    def numbers(self) -> list[set[int]]:
        """Numbers of the samples in each strain vector; fails on voltages that were not sent."""
        try:
            return [
                {
                    number_of(p, np.array(message.strain[8 * p : 8 * p + 8]))
                    for p in range(2)
                    if not message.status[p] & message.MISSING
                }
                for message in self.strains
            ]
        except AssertionError as error:
            if self._longest_s > _PAUSE_S:
                raise StarvedError(f"a cycle took {self._longest_s:.3f} s to send; {error}") from None
            raise


@pytest.fixture
def hand(simulated_can: dict[str, Any], probe: Any) -> Iterator[Hand]:
    one = Hand(simulated_can, probe)
    yield one
    one.bus.shutdown()


@pytest.mark.parametrize("name", BAD_PARAMETERS)
def test_an_invalid_configuration_is_rejected_in_one_line(refusal, parameters, name):
    bad, reason = BAD_PARAMETERS[name]
    (line,) = refusal("driver_node", {**parameters, **bad})
    assert reason in line


def test_each_cycle_is_one_message_with_its_receive_time(node_process, parameters, hand, probe):
    node_process("driver_node", parameters)
    hand.start()
    begin_ns = time.time_ns()
    numbers: list[int] = []
    for count in range(20, 320, 20):  # a busy machine loses what a queue does not hold
        numbers += hand.send_cycles(20)
        probe.until(lambda: len(hand.strains) >= count, f"{count} strain vectors")  # noqa: B023
    assert hand.numbers() == [{n} for n in numbers]
    assert [list(message.sequence) for message in hand.strains] == [[n, n] for n in numbers]
    stamps = [stamp_of(message) for message in hand.strains]
    assert begin_ns - 10**6 < stamps[0] < stamps[-1] < time.time_ns()
    assert stamps == sorted(stamps)
    assert list(hand.strains[0].phalanges) == ["index", "middle"]
    assert probe.change("tactile_driver", "deactivate")
    assert probe.change("tactile_driver", "activate")
    hand.strains.clear()
    hand.start()
    probe.node.create_publisher(StrainVectors, "strain", 10)
    probe.until(lambda: "found 2" in status_of(hand.reports, "tactile_driver: CAN bus")[1], "the other one")


def test_simulated_time_stamps_with_the_node_clock(node_process, parameters, hand, probe):
    node_process("driver_node", {**parameters, "use_sim_time": True})
    clock = probe.publisher(Clock, "/clock")

    def stamped() -> bool:
        clock.publish(Clock(clock=Time(sec=17, nanosec=5)))
        return bool(hand.strains) and stamp_of(hand.strains[-1]) == 17 * 10**9 + 5

    hand.sending(stamped, "a stamp of simulated time")


def test_a_tare_is_published_stored_and_cleared(node_process, parameters, probe, hand):
    offsets = probe.listen(StrainVectors, "tactile_driver/tare_offset", probe.latched)

    def wait_for_offset(expected: list[float], what: str, after: int = 0) -> None:
        """Wait until the newest of more than ``after`` offsets is ``expected``, V."""
        probe.until(
            lambda: len(offsets) > after and np.allclose(offsets[-1].strain, expected, atol=0.001), what
        )

    node = node_process("driver_node", parameters=parameters)
    wait_for_offset([0.0] * 16, "the offset at the start")  # a tare is never automatic
    hand.rests = True
    raw = [0.5] * 8 + [1.5] * 8
    hand.wait_for_strain(raw, "strain of the hand at rest")
    before = len(hand.strains)
    answers = (hand.call("tare") for _ in range(20))  # a busy machine holds the hand up: too few samples
    answer = next(one for one in answers if "samples of" not in one.message)
    assert answer.success, answer.message
    assert len(hand.strains) > before + 3  # strain was published during the tare
    hand.wait_for_strain([0.0] * 16, "strain without the offset")
    wait_for_offset(raw, "the new offset")

    assert node.stop() == 0
    count = len(offsets)
    hand.strains.clear()
    node = node_process("driver_node", parameters=parameters)
    wait_for_offset(raw, "the stored offset", after=count)
    hand.wait_for_strain([0.0] * 16, "strain without the stored offset")
    assert hand.call("clear_tare").success
    hand.wait_for_strain(raw, "raw strain")
    assert not Path(parameters["tare_file"]).read_text().count("index")


def test_two_hands_have_separate_diagnostics_and_tares(process, parameters, probe, tmp_path):
    del parameters["tare_file"]
    for hand in ("left", "right"):
        process(node_command("driver_node", parameters, namespace=f"/{hand}"), {"ROS_HOME": str(tmp_path)})
    reports = probe.diagnostics()
    wanted = {"left/tactile_driver: CAN bus", "right/tactile_driver: CAN bus"}
    probe.until(lambda: wanted <= {status.name for array in reports for status in array.status}, "both")
    for hand in ("left", "right"):
        answer = probe.trigger(f"{hand}/tactile_driver/clear_tare")
        assert answer.message.endswith(f"stored in {tmp_path}/tactile_localizer/{hand}/tare.yaml")
