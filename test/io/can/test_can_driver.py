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
from support.load_cells import count_from_here, cycle, number_of, protocol, strain_of
from support.waiting import wait_until

from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.can.bus import BusSettings, open_bus
from tactile_localizer.io.can.cycle import Cycle
from tactile_localizer.io.can.driver import DriverSettings, LoadCellDriver
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.can.reader import OPEN
from tactile_localizer.io.status import MISSING, OK

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
        settings = DriverSettings(bus, cycle_timeout_s=0.5, backoff_s=0.01)
        self.driver = LoadCellDriver(self.hand, settings, self.cycles.append, self.log.append)
        monkeypatch.setattr("tactile_localizer.io.can.driver.open_bus", self.open)
        self.sender = can.Bus(**simulated_can, hop_limit=0)
        self.sent = 0
        self.driver.start()
        for _ in range(50):  # until the load cells are aligned
            for n in range(-32, 0):
                self.send(cycle(self.hand, n), pause_s=0.002)
            self.settle()
            if all(self.driver.aligned):
                break
        assert all(self.driver.aligned)
        count_from_here(self.driver._assembler)
        self.cycles.clear()
        self.sent = 0

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


class SteppingClock:
    """Clock of the driver and its bus, which the test can step."""

    def __init__(self) -> None:
        self.step_s = 0.0

    def time_ns(self) -> int:
        return time.time_ns() + round(self.step_s * 1e9)

    def stamped(self, bus: can.BusABC) -> can.BusABC:
        """Make ``bus`` stamp its frames by this clock."""
        receive = bus.recv

        def recv(timeout: float | None = None) -> can.Message | None:
            message = receive(timeout)
            if message is not None:
                message.timestamp += self.step_s
            return message

        bus.recv = recv  # type: ignore[method-assign]
        return bus


def assert_unmixed(cycles: list[Cycle]) -> None:
    for one in cycles:
        numbers = {
            number_of(p, one.strain[8 * p : 8 * p + 8]) for p in range(2) if not one.status[p] & MISSING
        }
        assert len(numbers) <= 1


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


def test_bursts_of_garbage_are_counted_by_kind(bench: Callable[..., Bench]) -> None:
    one = bench()
    rng = np.random.default_rng(0)
    key = HAND.encode(0, np.zeros(8), 0)[0].arbitration_id
    sent = dict.fromkeys(FrameKind, 0)
    for n in range(300):
        one.send(cycle(HAND, n), pause_s=0.003)
        sent[FrameKind.DATA] += 4
        if n % 10 == 9:  # a burst of four: 10 % of the traffic
            known = {"arbitration_id": key, "is_extended_id": False}
            kinds = {
                FrameKind.UNKNOWN_ID: can.Message(
                    arbitration_id=0x7FF, is_extended_id=False, data=rng.bytes(8)
                ),
                FrameKind.WRONG_LENGTH: can.Message(**known, data=rng.bytes(rng.integers(0, 8))),
                FrameKind.REMOTE: can.Message(**known, is_remote_frame=True, dlc=8),
                FrameKind.ERROR: can.Message(arbitration_id=0x04, is_error_frame=True, data=rng.bytes(8)),
            }
            for kind, frame in kinds.items():
                one.send([frame])
                sent[kind] += 1
    one.settle()
    assert one.frames == [sent[kind] for kind in FrameKind]
    assert [made.sequence[0] for made in one.cycles] == list(range(300))
    assert one.driver.counts.incomplete == 0


def test_lost_frames_are_counted_exactly(bench: Callable[..., Bench]) -> None:
    one = bench()
    rng = np.random.default_rng(1)
    lost = 0
    for n in range(600):
        frames = cycle(HAND, n)
        kept = [frame for frame in frames if rng.random() >= 0.05 or n in (0, 599)]
        lost += len(frames) - len(kept)
        one.send(kept, pause_s=0.003)
    one.settle()
    counts = one.driver.counts
    assert lost > 50
    assert sum(phalanx.drops for phalanx in counts.phalanges) == lost
    assert counts.frames[FrameKind.DATA] == 2400 - lost
    missing = sum(status & MISSING for made in one.cycles for status in made.status)
    whole_cycles_lost = 600 - len(one.cycles)
    assert missing == sum(phalanx.missing for phalanx in counts.phalanges)
    assert counts.phalanges[0].samples + counts.phalanges[0].missing + whole_cycles_lost == 600
    assert_unmixed(one.cycles)


def test_a_closed_bus_is_reopened_by_the_driver(bench: Callable[..., Bench]) -> None:
    one = bench()
    for n in range(50):
        one.send(cycle(HAND, n), pause_s=0.003)
    one.settle()
    one.opened[-1].shutdown()
    wait_until(lambda: one.driver.status.reconnects == 1 and one.driver.status.state == OPEN, "the bus", 5.0)
    for n in range(61, 111):  # what was sent meanwhile nobody can know
        one.send(cycle(HAND, n), pause_s=0.003)
    one.settle()
    assert [made.sequence[0] for made in one.cycles[:50]] == list(range(50))
    assert len(one.cycles) == 100
    assert one.driver.counts.incomplete == 10  # until the counters are aligned
    assert [phalanx.drops for phalanx in one.driver.counts.phalanges] == [0, 0]


@pytest.mark.parametrize("step_s", [-30.0, 30.0])
def test_a_clock_step_costs_at_most_one_cycle(
    bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    clock = SteppingClock()
    monkeypatch.setattr("tactile_localizer.io.can.driver.time", clock)
    one = bench()
    monkeypatch.setattr(
        "tactile_localizer.io.can.driver.open_bus", lambda *arguments: clock.stamped(one.open(*arguments))
    )
    one.driver.reconnect()
    wait_until(lambda: one.driver.status.reconnects == 1, "the bus with the clock", 5.0)
    for n in range(-32, 0):
        one.send(cycle(HAND, n), pause_s=0.003)
    one.settle()
    before = one.driver.counts.incomplete
    for n in range(100):
        frames = cycle(HAND, n)
        one.send(frames[:2])
        clock.step_s = 0.0 if n < 50 else step_s  # within the cycle
        one.send(frames[2:], pause_s=0.003)
    one.settle()
    assert one.frames[FrameKind.DATA] >= 4 * 132 - 4
    assert one.driver.counts.incomplete - before <= 2
    assert number_of(1, one.cycles[-1].strain[8:]) == 99
    assert one.cycles[-1].stamp_ns - one.cycles[0].stamp_ns == pytest.approx(step_s * 1e9, abs=5e9)
    assert_unmixed(one.cycles)


def test_a_silent_phalanx_is_missing_and_returns(bench: Callable[..., Bench]) -> None:
    one = bench(dbc="loadcells_fd.dbc")
    for n in range(150):
        one.send(cycle(one.hand, n)[:1] if 50 <= n < 100 else cycle(one.hand, n), pause_s=0.002)
    one.settle()
    assert [made.status.tolist() for made in one.cycles] == [[OK, OK]] * 50 + [[OK, MISSING]] * 50 + [
        [OK, OK]
    ] * 50
    assert_unmixed(one.cycles)
    assert one.driver.counts.phalanges[1].drops == 50


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


def test_random_frames_on_the_bus_are_counted(bench: Callable[..., Bench]) -> None:
    one = bench()
    rng = np.random.default_rng(3)
    known = [message.key for message in HAND.messages]
    for n in range(100):
        garbage = []
        for _ in range(20):
            is_known = bool(rng.integers(2))
            remote = bool(rng.integers(2))
            garbage.append(
                can.Message(
                    arbitration_id=int(rng.choice(known)) if is_known else int(rng.integers(2**29)),
                    is_extended_id=not is_known,
                    is_remote_frame=remote,
                    is_fd=not remote,
                    data=b"" if remote else rng.bytes(rng.choice([0, 1, 8, 12, 64])),
                )
            )
        one.send(garbage)
        one.send(cycle(HAND, n), pause_s=0.003)
    one.settle()
    assert one.driver.status.state == OPEN
    assert sum(one.frames) == 100 * 24
    for n in range(100, 200):  # frames that look like a load cell's disturb, but only for a while
        one.send(cycle(HAND, n), pause_s=0.003)
    one.settle()
    assert [made.status.tolist() for made in one.cycles[-20:]] == [[OK, OK]] * 20
    assert_unmixed(one.cycles[-20:])


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
    # On a busy machine, whose pauses fall anywhere, a load cell may have to be aligned again first.
    wait_until(
        lambda: send(1) or any(not any(made.status) for made in one.cycles[tared:]), "a complete cycle"
    )
    for made in one.cycles[tared:]:
        np.testing.assert_allclose(made.strain[np.isfinite(made.strain)], 0, atol=1e-9)
    raw = one.driver.latest.strain  # type: ignore[union-attr]
    np.testing.assert_allclose(raw - offset, one.cycles[-1].strain, atol=1e-9)

    with pytest.raises(MeasurementError, match="at rest"):
        one.driver.tare(0.2, 0.02, lambda: send(10, moving=0.01))
    np.testing.assert_array_equal(one.driver.offset, offset)
