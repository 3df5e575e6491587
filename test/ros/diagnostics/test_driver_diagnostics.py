"""What the driver node reports of its bus and of each phalanx."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import can
import pytest
from support.load_cells import cycle, protocol, sample

from tactile_localizer.io.can.bus import BusSettings
from tactile_localizer.io.can.driver import OPEN, WAITING, LoadCellDriver
from tactile_localizer.io.can.error_frames import BUS_OFF, NO_ACKNOWLEDGEMENT
from tactile_localizer.ros.diagnostics.driver import DriverDiagnostics

HAND = protocol()
OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
STALE_S = 0.5
PERIOD_NS = 10_000_000


class Reports:
    """Diagnostics of a driver whose frames and whose time are those of the test."""

    def __init__(self) -> None:
        self.driver = LoadCellDriver(HAND, BusSettings("virtual", "none"), print, print, print)
        self.driver.status.state = OPEN
        self.driver.read_ns += 10**12  # ahead of real time: it is not late, however long a test takes
        self.number, self.publishers = 0, 1
        publisher: Any = SimpleNamespace(
            status=lambda name, level, message, values: (name, (level, message, values))
        )
        self._diagnostics = DriverDiagnostics(self.driver, publisher, STALE_S, lambda: self.publishers)

    def receive(self, frames: Sequence[can.Message]) -> None:
        """Receive frames, and let a period pass."""
        self.driver.assembler.feed(frames)
        self.driver.read_ns += PERIOD_NS
        self.number += 1

    def send(self, *phalanges: int, count: int = 1, volts: float = 0.0, status: int = 0) -> None:
        """Receive cycles with a sample of each of these phalanges."""
        for _ in range(count):
            stamp_s, strain = 1e-9 * self.driver.read_ns, [volts, *7 * [0.0]]
            samples = [HAND.encode(p, strain, self.number, status, stamp_s) for p in phalanges]
            self.receive([frame for frames in samples for frame in frames])

    def now(self) -> dict[str, tuple[bytes, str, dict[str, Any]]]:
        """Level, message and values of the bus and of each phalanx."""
        return dict(self._diagnostics.statuses())  # type: ignore[call-overload]


@pytest.fixture
def reports() -> Reports:
    return Reports()


def test_a_hand_that_is_switched_off_is_idle(reports):
    assert [found[:2] for found in reports.now().values()] == [(OK, "open, idle"), (OK, "idle"), (OK, "idle")]


def test_that_frames_were_read_late_is_reported_once(reports):
    reports.send(0, 1, count=3)
    reports.now()
    reports.driver.late_ns = 100 * 10**9
    reports.send(0, 1)
    level, message, _ = reports.now()["CAN bus"]
    assert (level, message) == (WARN, "read 100.0 s late: 0 frames discarded")
    reports.send(0, 1)
    assert reports.now()["CAN bus"][:2] == (OK, "open")


def test_a_load_cell_is_stale_while_another_one_sends(reports):
    reports.send(0, 1, count=100)
    assert [found[:2] for found in reports.now().values()] == [(OK, "open"), (OK, "OK"), (OK, "OK")]
    reports.send(0, count=100)
    found = reports.now()
    assert found["index"][:2] == (OK, "OK")
    assert float(found["index"][2]["rate_hz"]) > 1
    assert float(found["index"][2]["age_s"]) == pytest.approx(0.01)
    assert found["middle"][:2] == (ERROR, "stale: no frames for 1.0 s")
    reports.send(0, 1, count=2)
    assert reports.now()["middle"][2]["drops"] == 2 * 100


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"volts": 9.0}, "saturated: gauge_1 is 2."),
        ({"status": 3}, "fault reported by the load cell: status 3"),
    ],
)
def test_what_a_load_cell_reports_is_reported(reports, values, message):
    reports.send(0, 1, count=2)
    reports.send(0, **values)
    reports.send(0, 1)
    assert reports.now()["index"][1].startswith(message)
    reports.send(0, 1)
    assert reports.now()["index"][1] == "OK"


def test_a_slow_load_cell_is_not_missing_before_its_rate_is_known(reports):
    messages = []
    for n in range(300):
        slow = [] if n % 5 else sample(HAND, 1, n // 5, reports.driver.read_ns)
        reports.receive(sample(HAND, 0, n, reports.driver.read_ns) + slow)
        if n in (30, 60, 299):
            messages.append(reports.now()["middle"][1])
    assert messages == ["OK", "OK", "OK, in one of 5 cycles"]


def test_frames_that_are_not_used_are_named(reports):
    short = can.Message(arbitration_id=0x102, is_extended_id=False, data=bytes(3))
    reports.send(0, 1)
    reports.receive([short, *cycle(HAND, 1, reports.driver.read_ns)])
    level, message, values = reports.now()["CAN bus"]
    assert (level, values["frames_wrong_length"]) == (WARN, 1)
    assert message == "discarded frames: 1 wrong length: 0x102 index_a: 3 bytes instead of 8"


def test_frames_that_are_not_those_of_the_dbc_are_named(reports):
    reports.receive(
        [can.Message(arbitration_id=number, is_extended_id=True, data=bytes(8)) for number in (0x700, 0x102)]
    )
    found = reports.now()
    assert found["CAN bus"][0] == WARN
    assert "none with an identifier of the DBC, the last 0x700" in found["CAN bus"][1]
    assert found["index"][:2] == (ERROR, "0x102 index_a: an identifier of 29 bits instead of 11")
    reports.receive(cycle(HAND, 0, reports.driver.read_ns)[:1])
    assert reports.now()["index"][:2] == (ERROR, "0x103 index_b not received")


def test_two_senders_and_two_drivers_are_reported(reports):
    for number in range(30):
        stamp_ns = reports.driver.read_ns
        reports.receive(cycle(HAND, number, stamp_ns) + cycle(HAND, number + 5, stamp_ns + PERIOD_NS // 2))
    assert "two load cells with its identifiers" in reports.now()["middle"][1]
    reports.publishers = 2
    assert reports.now()["CAN bus"][:2] == (ERROR, "expected one publisher of strain, found 2")


def test_errors_of_the_bus_and_its_controller_are_reported(reports):
    status = reports.driver.status
    status.errors[NO_ACKNOWLEDGEMENT] += 2
    assert reports.now()["CAN bus"][:2] == (WARN, f"bus errors: 2 {NO_ACKNOWLEDGEMENT}")
    status.controller = BUS_OFF
    level, message, values = reports.now()["CAN bus"]
    assert (level, values["controller"]) == (ERROR, BUS_OFF)
    assert message == "bus off: wrong bit rate, wiring or termination"
    status.state, status.error = WAITING, "Network is down"
    assert reports.now()["CAN bus"][:2] == (ERROR, "waiting: Network is down")
