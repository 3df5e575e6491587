"""Parameters, services and diagnostics of the driver node."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from support.diagnostics import status_of
from support.load_cells import cycle, protocol
from support.processes import node_command

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
        "tare_duration_s": 1.0,  # enough for the 10 samples that a tare needs, even on a busy machine
        "period_s": 1.0,  # on a busy machine the test can pause between two frames,
        "max_age_s": 60.0,  # or the driver before it reads them
    }


class Hand:
    """Load cells that send a cycle whenever a condition is evaluated."""

    def __init__(self, simulated_can: dict[str, Any]) -> None:
        self.bus = can.Bus(**simulated_can, hop_limit=0)
        self.number = 0
        self.silent: set[int] = set()
        self.swing: float | None = None  # V between two samples; None: distinguishable samples

    def send(self, frames: list[can.Message] | None = None) -> None:
        if frames is None and self.swing is not None:
            strain = 0.5 + self.swing * (self.number % 2)
            frames = [f for p in range(2) for f in HAND.encode(p, np.full(8, strain + p), self.number)]
        for frame in frames or cycle(HAND, self.number):
            if (frame.arbitration_id - 0x102) // 2 not in self.silent:
                self.bus.send(frame)
        self.number += 1


@pytest.fixture
def hand(simulated_can: dict[str, Any]) -> Iterator[Hand]:
    one = Hand(simulated_can)
    yield one
    one.bus.shutdown()


@pytest.mark.parametrize("name", BAD_PARAMETERS)
def test_an_invalid_configuration_is_rejected_in_one_line(
    refusal: Callable[..., list[str]], parameters: dict[str, Any], name: str
) -> None:
    bad, reason = BAD_PARAMETERS[name]
    (line,) = refusal("driver_node", {**parameters, **bad})
    assert reason in line


def test_an_invalid_configuration_ends_the_process(node_process: Callable[..., Any]) -> None:
    node = node_process("driver_node", parameters={"dbc": "/nowhere/hand.dbc"})
    assert node.wait() == 2
    assert "/nowhere/hand.dbc: expected a DBC file" in node.output
    assert len(node.lines) == 1


def values(arrays: list[Any], what: str) -> tuple[bytes, str, dict[str, str]]:
    return status_of(arrays, f"driver: {what}")


def test_diagnostics_distinguish_idle_ok_and_stale(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:
    from diagnostic_msgs.msg import DiagnosticStatus

    arrays = probe.diagnostics()
    node_process("driver_node", parameters=parameters)

    def reports(what: str, message: str) -> bool:
        return message in values(arrays, what)[1]

    probe.until(lambda: reports("CAN bus", "open, idle"), "an idle bus")
    assert all(status.level == DiagnosticStatus.OK for status in arrays[-1].status)
    assert "idle" in values(arrays, "index")[1]

    sent = hand.number

    def sending(
        what: str, message: str, volts: float = 0.0, status: int = 0, index: str = ""
    ) -> Callable[[], bool]:
        def condition() -> bool:
            strain = [volts] + 7 * [0.0]
            hand.send([f for p in range(2) for f in HAND.encode(p, strain, hand.number, status)])
            return reports(what, message) and reports("index", index)

        return condition

    probe.until(sending("middle", "OK", index="OK"), "phalanges with status OK")
    level, _, index = values(arrays, "index")
    assert level == DiagnosticStatus.OK
    assert float(index["rate_hz"]) > 1
    assert 0 <= float(index["age_s"]) < 0.5  # else it would be stale

    hand.silent = {1}
    probe.until(sending("middle", "stale", index="OK"), "a stale phalanx beside another")
    assert values(arrays, "middle")[0] == DiagnosticStatus.ERROR
    assert values(arrays, "index")[0] == DiagnosticStatus.OK

    hand.silent = set()
    error = can.Message(arbitration_id=0x04, is_error_frame=True, data=bytes(8))
    short = can.Message(arbitration_id=0x102, is_extended_id=False, data=bytes(3))
    for frame in (error, error, short):
        hand.bus.send(frame)
    probe.until(sending("CAN bus", "wrong length"), "a warning of bad frames")
    probe.until(sending("index", "saturated", volts=9.0), "a saturated gauge")
    probe.until(sending("index", "fault reported by the load cell", status=3), "a fault")
    probe.until(
        lambda: reports("index", "stale") and reports("middle", "stale"), "both stale, as nothing is sent"
    )
    _, _, counted = values(arrays, "CAN bus")
    assert (counted["frames_error"], counted["frames_wrong_length"]) == ("2", "1")
    complete = int(values(arrays, "index")[2]["samples"])
    assert complete == hand.number - sent
    middle = values(arrays, "middle")[2]
    assert int(middle["drops"]) == 2 * (complete - int(middle["samples"])) > 0


def test_two_senders_and_two_drivers_are_reported(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:

    from tactile_localizer.msg import StrainVectors

    arrays = probe.diagnostics()
    node_process("driver_node", parameters=parameters)

    def reported(what: str, message: str) -> Callable[[], bool]:
        def condition() -> bool:
            frames = [f for n in (hand.number, hand.number + 5) for f in cycle(HAND, n)]
            hand.send(frames)
            return message in values(arrays, what)[1]

        return condition

    probe.until(reported("middle", "two load cells with"), "two senders of a phalanx")
    second = probe.node.create_publisher(StrainVectors, "strain", 10)
    probe.until(reported("CAN bus", "found 2"), "two publishers")
    probe.node.destroy_publisher(second)


class Tares:
    """Strain, offsets and services of a driver node while ``hand`` sends."""

    def __init__(self, probe: Any, hand: Hand) -> None:
        from tactile_localizer.msg import StrainVectors

        self.strains = probe.listen(StrainVectors, "strain", probe.best_effort)
        self.offsets = probe.listen(StrainVectors, "driver/tare_offset", probe.latched)
        self._probe, self._hand = probe, hand

    def sending(self, condition: Callable[[], Any], what: str) -> None:
        """Send until ``condition`` is true."""

        def sent() -> bool:
            self._hand.send()
            return bool(condition())

        self._probe.until(sent, what)

    def wait_for_strain(self, expected: list[float], what: str) -> None:
        """Send until the newest strain is ``expected``, V."""
        self.sending(
            lambda: self.strains and np.allclose(self.strains[-1].strain, expected, atol=0.001), what
        )

    def wait_for_offset(self, expected: list[float], what: str, after: int = 0) -> None:
        """Wait until the newest of more than ``after`` offsets is ``expected``, V."""
        self._probe.until(
            lambda: len(self.offsets) > after and np.allclose(self.offsets[-1].strain, expected, atol=0.001),
            what,
        )

    def call(self, service: str) -> Any:
        """The response of a service while the hand sends."""
        from std_srvs.srv import Trigger

        client = self._probe.node.create_client(Trigger, f"driver/{service}")
        self._probe.until(client.service_is_ready, service)
        self._probe.known_to("driver")
        future = client.call_async(Trigger.Request())
        self.sending(future.done, f"an answer of {service}")
        return future.result()


def test_a_tare_requires_a_hand_at_rest(
    node_process: Callable[..., Any], parameters: dict[str, Any], probe: Any, hand: Hand
) -> None:
    tares = Tares(probe, hand)
    node_process("driver_node", parameters=parameters)
    tares.wait_for_offset([0.0] * 16, "the offset at the start")
    hand.swing = 0.25
    tares.sending(lambda: tares.strains, "strain of a hand that moves")
    moving = tares.call("tare")
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
    before = len(tares.strains)
    answer = tares.call("tare")
    assert answer.success, answer.message
    assert len(tares.strains) > before + 3  # strain was published during the tare
    tares.wait_for_strain([0.0] * 16, "strain without the offset")
    tares.wait_for_offset(raw, "the new offset")

    assert node.stop() == 0
    count = len(tares.offsets)
    tares.strains.clear()
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
    wanted = {"left/driver: CAN bus", "right/driver: CAN bus"}
    probe.until(lambda: wanted <= {status.name for array in reports for status in array.status}, "both")
    for hand in ("left", "right"):
        answer = probe.trigger(f"{hand}/driver/clear_tare")
        assert answer.message.endswith(f"stored in {tmp_path}/tactile_localizer/{hand}/tare.yaml")
