"""Parameters, services and diagnostics of the driver node."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest
from support.diagnostics import status_of
from support.load_cells import cycle, number_of, protocol, sample
from support.processes import node_command
from support.sweeps import stamp_of
from support.waiting import StarvedError

from tactile_localizer.io.can.bus import BusSettings
from tactile_localizer.io.can.driver import OPEN, LoadCellDriver

pytestmark = pytest.mark.ros

HAND = protocol()
BAD_PARAMETERS = {
    "no such DBC": ({"dbc": "/nowhere/hand.dbc"}, "/nowhere/hand.dbc: expected a DBC file, No such file"),
    "a DBC without the phalanx": ({"phalanges": ["pinky"]}, "phalanx 'pinky': expected a message pinky"),
    "an unknown interface": ({"interface": "canopener"}, "CAN bus canopener 239.74.163.2: expected"),
    "a period out of range": ({"period_s": 5.0}, "period_s"),
    "a period that is text": ({"period_s": "long"}, "expecting type 'DOUBLE'"),
    "an option without a value": ({"bus_options": ["port"]}, "bus option 'port': expected name=value"),
    "no phalanges": (
        {"phalanges": []},
        "parameter phalanges: expected a value such as ['index', 'middle'], got []",
    ),
    "a file that is no tare": ({"tare_file": str(Path(__file__))}, "expected YAML"),
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
        from tactile_localizer.msg import StrainVectors

        self.bus, self._probe = can.Bus(**simulated_can, hop_limit=0), probe
        self.number = self.sent = 0  # of the next cycle; frames
        self._longest_s = 0.0  # that the frames of a cycle took
        self.silent: set[int] = set()
        self.swing: float | None = None  # V between two samples; None: distinguishable samples
        self.strains: list[Any] = probe.listen(StrainVectors, "strain", probe.best_effort)
        self.reports: list[Any] = probe.diagnostics()

    def send(self, frames: list[can.Message] | None = None) -> None:
        if frames is None and self.swing is not None:
            strain = 0.5 + self.swing * (self.number % 2)
            frames = [f for p in range(2) for f in HAND.encode(p, np.full(8, strain + p), self.number)]
        time.sleep(_PAUSE_S)
        begin_s = time.monotonic()
        for frame in frames or cycle(HAND, self.number):
            if (frame.arbitration_id - 0x102) // 2 not in self.silent:
                self.bus.send(frame)
                self.sent += 1
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

    def start(self) -> None:
        """Send until the driver has published the last cycle; then count and gather from now on."""
        self._probe.until(lambda: self.reports, "the driver")
        self.sending(lambda: self.strains and not any(self.strains[-1].status), "whole strain vectors")
        self._probe.until(lambda: self.numbers()[-1] == {self.number - 1}, "the last cycle sent")
        self.strains.clear()

    def numbers(self) -> list[set[int]]:
        """Numbers of the samples in each strain vector; fails on voltages that were not sent."""
        with self.sent_in_bursts():
            return [
                {
                    number_of(p, np.array(message.strain[8 * p : 8 * p + 8]))
                    for p in range(2)
                    if not message.status[p] & message.MISSING
                }
                for message in self.strains
            ]

    @contextmanager
    def sent_in_bursts(self) -> Iterator[None]:
        """Context of what holds if no cycle took longer to send than the pause to the next."""
        try:
            yield
        except AssertionError as error:
            if self._longest_s > _PAUSE_S:
                raise StarvedError(f"a cycle took {self._longest_s:.3f} s to send; {error}") from None
            raise

    def status(self, name: str) -> tuple[bytes, str, dict[str, str]]:
        """Level, message and values of the newest status of the bus or a phalanx."""
        return status_of(self.reports, f"tactile_driver: {name}")

    def until_counted(self, **values: object) -> None:
        """Wait for diagnostics with these values, and until the driver has counted every frame sent."""
        wanted = {key: str(value) for key, value in {"frames_data": self.sent, **values}.items()}
        self._probe.until(lambda: wanted.items() <= self.status("CAN bus")[2].items(), str(wanted))


@pytest.fixture
def hand(simulated_can: dict[str, Any], probe: Any) -> Iterator[Hand]:
    one = Hand(simulated_can, probe)
    yield one
    one.bus.shutdown()


@pytest.mark.parametrize("name", BAD_PARAMETERS)
def test_an_invalid_configuration_is_rejected_in_one_line(
    refusal: Callable[..., list[str]], parameters: dict[str, Any], name: str
) -> None:
    bad, reason = BAD_PARAMETERS[name]
    (line,) = refusal("driver_node", {**parameters, **bad})
    assert reason in line


def test_each_cycle_is_one_message_with_its_receive_time(
    node_process: Callable[..., Any], parameters: dict[str, Any], hand: Hand, probe: Any
) -> None:
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


def test_a_closed_bus_and_bus_off_are_survived(
    node_process: Callable[..., Any], parameters: dict[str, Any], hand: Hand, probe: Any
) -> None:
    node = node_process("driver_node", parameters)
    hand.start()
    sent = list(hand.send_cycles(10))
    hand.until_counted()
    assert probe.change("tactile_driver", "deactivate")
    hand.number += 5  # as while the bus is closed
    assert probe.change("tactile_driver", "activate")
    sent += hand.send_cycles(15)
    hand.bus.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
    hand.until_counted(controller="bus off")
    hand.number += 10
    sent += hand.send_cycles(15)
    hand.until_counted(controller="error active", frames_error=1)
    drops = [hand.status(name)[2]["drops"] for name in ("index", "middle")]
    with hand.sent_in_bursts():
        assert drops == ["0", "0"], "samples sent while the bus is closed are not counted"
    assert {n for numbers in hand.numbers() for n in numbers} >= set(sent)
    assert node.running
    assert "Traceback" not in node.output


def test_simulated_time_stamps_with_the_node_clock(
    node_process: Callable[..., Any], parameters: dict[str, Any], hand: Hand, probe: Any
) -> None:
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    node_process("driver_node", {**parameters, "use_sim_time": True})
    clock = probe.publisher(Clock, "/clock")

    def stamped() -> bool:
        clock.publish(Clock(clock=Time(sec=17, nanosec=5)))
        return bool(hand.strains) and stamp_of(hand.strains[-1]) == 17 * 10**9 + 5

    hand.sending(stamped, "a stamp of simulated time")


def test_diagnostics_distinguish_idle_ok_and_stale(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:
    from diagnostic_msgs.msg import DiagnosticStatus

    node_process("driver_node", parameters=parameters)

    def reports(what: str, message: str) -> bool:
        return message in hand.status(what)[1]

    probe.until(lambda: reports("CAN bus", "open, idle"), "an idle bus")
    assert all(status.level == DiagnosticStatus.OK for status in hand.reports[-1].status)
    assert "idle" in hand.status("index")[1]

    def until(what: str, message: str, volts: float = 0.0, status: int = 0, index: str = "") -> None:
        def condition() -> bool:
            strain = [volts] + 7 * [0.0]
            hand.send([f for p in range(2) for f in HAND.encode(p, strain, hand.number, status)])
            return reports(what, message) and reports("index", index)

        probe.until(condition, f"{what}: {message}")

    until("middle", "OK", index="OK")
    level, _, index = hand.status("index")
    assert level == DiagnosticStatus.OK
    assert float(index["rate_hz"]) > 1
    assert 0 <= float(index["age_s"]) < 0.5  # else it would be stale

    hand.silent, first = {1}, hand.number
    until("middle", "stale", index="OK")
    lost = hand.number - first
    assert hand.status("middle")[0] == DiagnosticStatus.ERROR
    assert hand.status("index")[0] == DiagnosticStatus.OK

    hand.silent = set()
    error = can.Message(arbitration_id=0x04, is_error_frame=True, data=bytes(8))
    short = can.Message(arbitration_id=0x102, is_extended_id=False, data=bytes(3))
    for frame in (error, error, short):
        hand.bus.send(frame)
    until("CAN bus", "wrong length: 0x102 index_a: 3 bytes instead of 8")
    until("index", "saturated", volts=9.0)
    until("index", "fault reported by the load cell", status=3)
    probe.until(
        lambda: reports("index", "stale") and reports("middle", "stale"), "both stale, as nothing is sent"
    )
    _, _, counted = hand.status("CAN bus")
    assert (counted["frames_error"], counted["frames_wrong_length"]) == ("2", "1")
    assert int(hand.status("middle")[2]["drops"]) >= 2 * lost > 0


def test_frames_that_are_not_those_of_the_dbc_are_named(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:
    from diagnostic_msgs.msg import DiagnosticStatus

    node_process("driver_node", parameters=parameters)
    foreign = [
        can.Message(arbitration_id=number, is_extended_id=True, data=bytes(8)) for number in (0x700, 0x102)
    ]

    def sent_foreign() -> bool:
        for frame in foreign:
            hand.bus.send(frame)
        return "none with an identifier of the DBC, the last 0x700" in hand.status("CAN bus")[1]

    probe.until(sent_foreign, "foreign frames")
    assert hand.status("CAN bus")[0] == DiagnosticStatus.WARN
    assert "0x102 index_a: an identifier of 29 bits instead of 11" in hand.status("index")[1]

    def sent_in_part() -> bool:
        hand.bus.send(cycle(HAND, hand.number)[0])
        return "0x103 index_b not received" in hand.status("index")[1]

    probe.until(sent_in_part, "a message that does not come")


def test_a_slow_load_cell_is_not_missing_before_its_rate_is_known() -> None:
    from tactile_localizer.ros.diagnostics.driver import DriverDiagnostics

    driver = LoadCellDriver(HAND, BusSettings("virtual", "slow"), print, print, print)
    driver.status.state = OPEN
    publisher: Any = SimpleNamespace(status=lambda name, level, message, values: (name, message))
    diagnostics = DriverDiagnostics(driver, publisher, stale_timeout_s=60.0)
    messages = []
    for n in range(300):
        stamp_ns = driver.read_ns + n * 10_000_000
        slow = [] if n % 5 else sample(HAND, 1, n // 5, stamp_ns)
        driver.assembler.feed(sample(HAND, 0, n, stamp_ns) + slow)
        if n in (30, 60, 299):
            messages.append(dict(diagnostics.statuses())["middle"])  # type: ignore[call-overload]
    assert messages == ["OK", "OK", "OK, in one of 5 cycles"]


def test_two_senders_and_two_drivers_are_reported(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:

    from tactile_localizer.msg import StrainVectors

    node_process("driver_node", parameters=parameters)

    def sent_twice() -> None:
        hand.send([f for n in (hand.number, hand.number + 5) for f in cycle(HAND, n)])

    probe.until(lambda: sent_twice() or "two load cells with" in hand.status("middle")[1], "two senders")
    second = probe.node.create_publisher(StrainVectors, "strain", 10)
    probe.until(lambda: sent_twice() or "found 2" in hand.status("CAN bus")[1], "two publishers")
    probe.node.destroy_publisher(second)


class Tares:
    """Strain, offsets and services of a driver node while ``hand`` sends."""

    def __init__(self, probe: Any, hand: Hand) -> None:
        from tactile_localizer.msg import StrainVectors

        self.offsets = probe.listen(StrainVectors, "tactile_driver/tare_offset", probe.latched)
        self._probe, self._hand = probe, hand

    def wait_for_strain(self, expected: list[float], what: str) -> None:
        """Send until the newest strain is ``expected``, V."""
        strains = self._hand.strains
        self._hand.sending(lambda: strains and np.allclose(strains[-1].strain, expected, atol=0.001), what)

    def wait_for_offset(self, expected: list[float], what: str, after: int = 0) -> None:
        """Wait until the newest of more than ``after`` offsets is ``expected``, V."""
        self._probe.until(
            lambda: len(self.offsets) > after and np.allclose(self.offsets[-1].strain, expected, atol=0.001),
            what,
        )

    def tare(self) -> Any:
        """The response to a tare in which the hand has sent enough samples: a busy machine holds it up."""
        for _ in range(20):
            if "samples of" not in (answer := self.call("tare")).message:
                break
        return answer

    def call(self, service: str) -> Any:
        """The response of a service while the hand sends."""
        from std_srvs.srv import Trigger

        client = self._probe.node.create_client(Trigger, f"tactile_driver/{service}")
        self._probe.until(client.service_is_ready, service)
        self._probe.known_to("tactile_driver")
        future = client.call_async(Trigger.Request())
        self._hand.sending(future.done, f"an answer of {service}")
        return future.result()


def test_a_tare_requires_a_hand_at_rest(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:
    tares = Tares(probe, hand)
    node_process("driver_node", parameters=parameters)
    tares.wait_for_offset([0.0] * 16, "the offset at the start")
    hand.swing = 0.25
    hand.sending(lambda: hand.strains, "strain of a hand that moves")
    moving = tares.tare()
    assert not moving.success
    assert "at rest" in moving.message
    assert len(tares.offsets) == 1
    assert not Path(parameters["tare_file"]).exists()


def test_a_tare_is_published_stored_and_cleared(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:
    tares = Tares(probe, hand)
    node = node_process("driver_node", parameters=parameters)
    tares.wait_for_offset([0.0] * 16, "the offset at the start")  # a tare is never automatic
    hand.swing = 0.0
    raw = [0.5] * 8 + [1.5] * 8
    tares.wait_for_strain(raw, "strain of the hand at rest")
    before = len(hand.strains)
    answer = tares.tare()
    assert answer.success, answer.message
    assert len(hand.strains) > before + 3  # strain was published during the tare
    tares.wait_for_strain([0.0] * 16, "strain without the offset")
    tares.wait_for_offset(raw, "the new offset")

    assert node.stop() == 0
    count = len(tares.offsets)
    hand.strains.clear()
    node = node_process("driver_node", parameters=parameters)
    tares.wait_for_offset(raw, "the stored offset", after=count)
    tares.wait_for_strain([0.0] * 16, "strain without the stored offset")
    assert tares.call("clear_tare").success
    tares.wait_for_strain(raw, "raw strain")
    assert not Path(parameters["tare_file"]).read_text().count("index")


def test_two_hands_have_separate_diagnostics_and_tares(
    process: Callable[..., Any], parameters: dict[str, Any], probe: Any, tmp_path: Path
) -> None:
    del parameters["tare_file"]
    for hand in ("left", "right"):
        process(node_command("driver_node", parameters, namespace=f"/{hand}"), {"ROS_HOME": str(tmp_path)})
    reports = probe.diagnostics()
    wanted = {"left/tactile_driver: CAN bus", "right/tactile_driver: CAN bus"}
    probe.until(lambda: wanted <= {status.name for array in reports for status in array.status}, "both")
    for hand in ("left", "right"):
        answer = probe.trigger(f"{hand}/tactile_driver/clear_tare")
        assert answer.message.endswith(f"stored in {tmp_path}/tactile_localizer/{hand}/tare.yaml")
