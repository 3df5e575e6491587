"""The driver on a simulated bus with faults: every frame is counted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import count, islice
from typing import Any

import can
import msgpack
import numpy as np
import pytest
from support.load_cells import cycle, protocol, strain_of
from support.waiting import wait_until

from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.can.assembler import Cycle
from tactile_localizer.io.can.bus import BusSettings, open_bus
from tactile_localizer.io.can.driver import LoadCellDriver
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.can.reader import OPEN

HAND = protocol()

MOST_UNREAD = 64
"""Most frames that the driver has not read yet; any kernel's buffer holds more."""


class Bench:
    """A driver on a simulated bus, and the other end of that bus."""

    def __init__(
        self, simulated_can: dict[str, Any], monkeypatch: pytest.MonkeyPatch, dbc: str = "loadcells.dbc"
    ) -> None:
        self.hand = protocol(dbc=dbc)
        self.cycles: list[Cycle] = []
        self.opened: list[can.BusABC] = []
        self.log: list[str] = []
        bus = BusSettings(
            "udp_multicast", simulated_can["channel"], {"port": simulated_can["port"]}, receive_buffer=1 << 20
        )
        # On a busy machine the test may be put aside between two frames of a cycle: they are late, not lost.
        self.driver = LoadCellDriver(
            self.hand, bus, self.cycles.append, period_s=1.0, backoff_s=0.01, log=self.log.append
        )
        monkeypatch.setattr("tactile_localizer.io.can.driver.open_bus", self.open)
        self.sender = can.Bus(**simulated_can, hop_limit=0)
        self.sent = 0
        self.driver.start()

    def open(self, settings: BusSettings, hand: LoadCellProtocol) -> can.BusABC:
        """Open the bus for the driver, and keep it so that the test can make it fail."""
        self.opened.append(open_bus(settings, hand))
        return self.opened[-1]

    def send(self, frames: list[can.Message], pause_s: float = 0.0) -> None:
        """Send ``frames``, once the driver has read most of what was sent before."""
        wait_until(lambda: self.sent - sum(self.frames) <= MOST_UNREAD, "the driver to keep up", 10.0)
        for frame in frames:
            self.sender.send(frame)
        self.sent += len(frames)
        if pause_s:  # else not even 0 s: on a busy machine that is as long as the pause between cycles
            time.sleep(pause_s)  # a pace, not a wait

    def settle(self) -> None:
        """Wait until all frames are counted and all cycles closed."""
        wait_until(lambda: sum(self.frames) == self.sent, f"{self.sent} frames", 10.0)
        wait_until(lambda: self.driver._assembler.remaining_ns(0) is None, "the last cycle to close", 5.0)

    @property
    def frames(self) -> list[int]:
        return self.driver.counts.frames

    def close(self) -> None:
        assert self.driver.stop()
        self.sender.shutdown()


@pytest.fixture
def bench(simulated_can: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(**kwargs: Any) -> Bench:
        made.append(Bench(simulated_can, monkeypatch, **kwargs))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.mark.parametrize("dbc", ["loadcells.dbc", "loadcells_fd.dbc"])
def test_cycles_arrive_once_and_in_order(bench: Callable[..., Bench], dbc: str) -> None:
    one = bench(dbc=dbc)
    for n in range(200):
        one.send(cycle(one.hand, n), pause_s=0.005)
    one.settle()
    assert [made.sequence.tolist() for made in one.cycles] == [[n, n] for n in range(200)]
    assert one.driver.counts.incomplete == 0
    np.testing.assert_allclose(one.cycles[77].strain[8:], strain_of(1, 77), atol=1e-4)
    assert abs(one.cycles[-1].stamp_ns * 1e-9 - time.time()) < 5  # by the receiver's clock, not the sender's


def test_invalid_datagrams_are_counted(
    bench: Callable[..., Bench],
) -> None:
    one = bench()
    rng = np.random.default_rng(2)
    datagrams = [rng.bytes(int(rng.integers(1, 60))) for _ in range(50)]
    datagrams += [msgpack.packb({"dlc": 99, "data": b"", "arbitration_id": -1}), msgpack.packb([1]), b"\x80"]
    one.send(cycle(HAND, 0))
    for datagram in datagrams:
        one.sender._multicast.send(datagram)  # type: ignore[attr-defined]
    one.send(cycle(HAND, 1))
    wait_until(lambda: len(one.cycles) == 2, "both cycles", 5.0)
    assert one.driver.status.unreadable + one.frames[FrameKind.UNKNOWN_ID] == len(datagrams)
    assert (one.driver.status.state, one.driver.status.reconnects) == (OPEN, 0)


def test_random_frames_are_counted_exactly_and_disturb_only_for_a_while(bench: Callable[..., Bench]) -> None:
    one, rng = bench(), np.random.default_rng(1)
    known = [message.key[0] for message in HAND.messages]
    expected = dict.fromkeys(FrameKind, 0)
    for _ in range(200):
        frames = []
        for remote, error, is_known in rng.random((50, 3)) < (0.1, 0.1, 0.5):
            length = 0 if remote else int(rng.choice([0, 3, 7, 8] if error else [0, 3, 7, 8, 8, 8, 12, 64]))
            kind = FrameKind.DATA if length == 8 else FrameKind.WRONG_LENGTH
            kind = FrameKind.REMOTE if remote else kind if is_known else FrameKind.UNKNOWN_ID
            kind = FrameKind.ERROR if error else kind
            expected[kind] += 1
            frames.append(
                can.Message(
                    arbitration_id=0x04 if error else int(rng.choice(known)) if is_known else 0x7FF,
                    is_extended_id=False,
                    is_remote_frame=bool(remote and not error),
                    is_error_frame=bool(error),
                    is_fd=length > 8,
                    data=rng.bytes(length),
                )
            )
        one.send(frames)
    wait_until(lambda: sum(one.frames) == one.sent, "all frames", 10.0)
    found = dict(zip(FrameKind, one.frames, strict=True))
    looks_good = FrameKind.DATA, FrameKind.DUPLICATE, FrameKind.OUT_OF_ORDER
    assert {kind: found[kind] for kind in FrameKind if kind not in looks_good} == {
        kind: expected[kind] for kind in FrameKind if kind not in looks_good
    }
    assert sum(found[kind] for kind in looks_good) == expected[FrameKind.DATA] > 1000
    for n in range(100):
        one.send(cycle(HAND, n), pause_s=0.005)
    one.settle()
    assert [made.sequence.tolist()[0] % 16 for made in one.cycles[-20:]] == [n % 16 for n in range(80, 100)]
    assert (one.driver.status.state, one.driver.status.reconnects) == (OPEN, 0)


def test_tare_subtracts_the_average(bench: Callable[..., Bench]) -> None:
    one = bench()
    strain = np.linspace(-1, 1, 8).round(3)
    numbers = count()

    def send(cycles: int, moving: float = 0.0) -> bool:  # called while the tare waits
        for n in islice(numbers, cycles):
            one.send([f for phalanx in range(2) for f in HAND.encode(phalanx, strain + moving * n, n)])
        one.settle()
        return False

    with pytest.raises(MeasurementError, match=r"at least 10 valid samples of index, got [0-9]"):
        one.driver.tare(0.3, 0.02, lambda: send(1))  # called every 0.1 s: too few
    before = len(one.cycles)
    offset = one.driver.tare(0.2, 0.02, lambda: send(10))
    np.testing.assert_allclose(offset, np.tile(strain, 2), atol=1e-9)
    assert len(one.cycles) > before
    tared = len(one.cycles)
    wait_until(lambda: send(1) or len(one.cycles) > tared, "a cycle")
    for made in one.cycles[tared:]:
        np.testing.assert_allclose(made.strain, 0, atol=1e-9)
    raw = one.driver.latest.strain  # type: ignore[union-attr]
    np.testing.assert_allclose(raw - offset, one.cycles[-1].strain, atol=1e-9)

    with pytest.raises(MeasurementError, match="at rest"):
        one.driver.tare(0.2, 0.02, lambda: send(10, moving=0.01))
    np.testing.assert_array_equal(one.driver.offset, offset)
