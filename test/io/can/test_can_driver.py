"""The driver on a simulated bus with faults, its tare, and frames that are late."""

import time
from typing import Any

import can
import msgpack
import numpy as np
import pytest
from support.load_cells import cycle, number_of, protocol
from support.waiting import wait_until

from tactile_localizer.io.can.assembler import Cycle
from tactile_localizer.io.can.bus import BusSettings
from tactile_localizer.io.can.driver import OPEN, LoadCellDriver
from tactile_localizer.io.can.protocol import FrameKind
from tactile_localizer.io.can.tare import MIN_SAMPLES

HAND = protocol()


def test_invalid_datagrams_are_counted_and_frames_behind_them_are_read(simulated_can: dict[str, Any]) -> None:
    bus = BusSettings("udp_multicast", simulated_can["channel"], {"port": simulated_can["port"]})
    driver = LoadCellDriver(HAND, bus, print, print, print, max_age_s=60.0)
    rng = np.random.default_rng(2)
    datagrams = [rng.bytes(int(rng.integers(1, 60))) for _ in range(50)]
    datagrams += [msgpack.packb({"dlc": 99, "data": b"", "arbitration_id": -1}), msgpack.packb([1]), b"\x80"]
    before, behind = cycle(HAND, 0), cycle(HAND, 1)
    driver.start()
    with can.Bus(**simulated_can, hop_limit=0) as sender:
        for frame in before:
            sender.send(frame)
        for datagram in datagrams:
            sender._multicast.send(datagram)  # type: ignore[attr-defined]
        for frame in behind:
            sender.send(frame)
        # Not the cycles: a gap between two frames, when the sender is put aside, would begin another one.
        wait_until(lambda: driver.counts.frames[FrameKind.DATA] == len(before + behind), "the last frame")
    assert driver.status.unreadable + driver.counts.frames[FrameKind.UNKNOWN_ID] == len(datagrams)
    assert (driver.status.state, driver.status.reconnects) == (OPEN, 0)
    assert driver.stop()


@pytest.fixture
def unstarted() -> LoadCellDriver:
    bus = BusSettings("virtual", "none")
    return LoadCellDriver(HAND, bus, print, print, print, period_s=1.0, max_age_s=60.0)


def test_a_tare_is_of_the_raw_strain(unstarted: LoadCellDriver) -> None:
    cycles: list[Cycle] = []

    def receive(duration_s: float) -> None:
        for number in range(MIN_SAMPLES + 2):  # the first and the last one are not complete
            sent = [HAND.encode(p, np.full(8, 0.5), number, stamp_s=time.time()) for p in range(2)]
            unstarted._deliver([frame for frames in sent for frame in frames])

    unstarted._on_cycle = cycles.append
    unstarted._stop.wait = receive  # type: ignore[assignment]
    for _ in range(2):
        np.testing.assert_allclose(unstarted.tare(1.0, spread_limit=0.01), 0.5, atol=1e-9)
    receive(1.0)
    np.testing.assert_allclose(cycles[-1].strain, 0.0, atol=1e-9)


def test_frames_that_waited_too_long_are_late(unstarted: LoadCellDriver) -> None:
    unstarted._deliver(cycle(HAND, 0, time.time_ns() - 100 * 10**9))
    unstarted._deliver(cycle(HAND, 1, time.time_ns()))
    assert unstarted.counts.frames[FrameKind.LATE] == unstarted.counts.frames[FrameKind.DATA] == 4
    assert unstarted.late_ns >= 100 * 10**9


@pytest.mark.parametrize("behind_s", [0.3, 2.0, 3600.0, -2.0, 1.7e9])
def test_a_sender_with_another_clock_is_not_late(behind_s: float) -> None:
    cycles: list[Cycle] = []
    bus = BusSettings("virtual", "clock")
    driver = LoadCellDriver(HAND, bus, cycles.append, print, print, max_age_s=60.0)
    driver.start()
    with can.Bus(interface="virtual", channel="clock", preserve_timestamps=True) as gateway:

        def sent_and_received() -> bool:
            number = len(received_ns)
            received_ns[number] = time.time_ns()
            for frame in cycle(HAND, number, time.time_ns() - round(behind_s * 1e9)):
                gateway.send(frame)
            return len(cycles) > 20

        received_ns: dict[int, int] = {}
        wait_until(sent_and_received, "strain")
    assert driver.stop()
    assert driver.counts.frames[FrameKind.LATE] == 0
    errors_ns = [one.stamp_ns - received_ns[number_of(0, one.strain[:8])] for one in cycles]
    assert np.median(np.abs(errors_ns)) < 10**7  # not of all: some may be sent late
    assert driver.status.clock is not None
    assert driver.status.clock.offset_s == pytest.approx(behind_s, abs=0.05)
