"""A bus is opened with its filters and its buffer, or refused in one line."""

from pathlib import Path
from typing import Any

import can
import pytest
from can.interfaces.virtual import VirtualBus
from support.load_cells import protocol

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.bus import (
    AbsentBusError,
    BusSettings,
    open_bus,
    parse_options,
    receive_queue,
)


@pytest.mark.parametrize(
    ("interface", "channel", "options", "is_absent"),
    [
        ("socketcan", "can7", {}, True),
        ("no_such_interface", "can0", {}, False),
        ("udp_multicast", "not an address", {}, True),
        ("udp_multicast", "239.74.163.2", {"hop_limit": "many"}, False),
    ],
)
def test_an_unusable_interface_is_refused(
    interface: str, channel: str, options: dict[str, Any], is_absent: bool
) -> None:
    with pytest.raises(CanError, match=f"CAN bus {interface} {channel}: expected") as refusal:
        open_bus(BusSettings(interface, channel, options), protocol())
    assert "\n" not in str(refusal.value)
    assert isinstance(refusal.value, AbsentBusError) == is_absent


def test_a_bus_that_fails_after_it_was_opened_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[can.BusABC] = []
    monkeypatch.setattr(VirtualBus, "shutdown", lambda bus: closed.append(bus))  # noqa: PLW0108 - binds
    monkeypatch.setattr(VirtualBus, "fileno", lambda bus: 1 / 0)
    with pytest.raises(CanError, match="expected an interface that opens, got: division by zero") as refusal:
        open_bus(BusSettings("virtual", "closed", receive_buffer=1000))
    assert closed, refusal  # which keeps the bus from being collected


def test_configuration_files_of_python_can_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulated_can: dict[str, Any]
) -> None:
    (tmp_path / ".canrc").write_text("[default]\nhop_limit = many\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("CAN_CONFIG", '{"hop_limit": "many"}')
    options = {"port": simulated_can["port"]}
    open_bus(BusSettings("udp_multicast", simulated_can["channel"], options)).shutdown()


def test_options_are_parsed_as_yaml() -> None:
    assert parse_options(["port=43113", "fd=true", "serial=A7"]) == {
        "port": 43113,
        "fd": True,
        "serial": "A7",
    }
    with pytest.raises(CanError, match="'port': expected name=value"):
        parse_options(["port"])
    with pytest.raises(CanError, match=r"'serial=\[A7': expected a value in YAML") as refusal:
        parse_options(["serial=[A7"])
    assert "\n" not in str(refusal.value)


def test_the_receive_buffer_has_the_given_size(
    simulated_can: dict[str, Any],
) -> None:
    options = {"port": simulated_can["port"]}
    bus = open_bus(BusSettings("udp_multicast", simulated_can["channel"], options, receive_buffer=50_000))
    sender = can.Bus(**simulated_can, hop_limit=0)
    for _ in range(1000):
        sender.send(can.Message(arbitration_id=1, is_extended_id=False, data=bytes(8)))
    queue = receive_queue(bus)
    assert queue is not None
    assert queue.limit == 50_000
    received = 0
    while bus.recv(0.05):
        received += 1
    assert receive_queue(bus).drops == 1000 - received > 0  # type: ignore[union-attr]
    sender.shutdown()
    bus.shutdown()
