"""The driver on a simulated bus with faults: every frame is counted."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import can
import msgpack
import numpy as np
import pytest
from support.load_cells import cycle, protocol
from support.waiting import wait_until

from tactile_localizer.io.can.assembler import Cycle
from tactile_localizer.io.can.bus import BusSettings
from tactile_localizer.io.can.driver import OPEN, LoadCellDriver
from tactile_localizer.io.can.protocol import FrameKind

HAND = protocol()

MOST_UNREAD = 64
"""Most frames that the driver has not read yet; any kernel's buffer holds more."""


class Bench:
    """A driver on a simulated bus, and the other end of that bus."""

    def __init__(self, simulated_can: dict[str, Any]) -> None:
        self.cycles: list[Cycle] = []
        bus = BusSettings(
            "udp_multicast", simulated_can["channel"], {"port": simulated_can["port"]}, receive_buffer=1 << 20
        )
        # On a busy machine the test or the thread may be put aside between two frames of a cycle.
        self.driver = LoadCellDriver(
            HAND, bus, self.cycles.append, period_s=1.0, max_age_s=60.0, log=print, note=print
        )
        self.sender = can.Bus(**simulated_can, hop_limit=0)
        self.sent = 0
        self.driver.start()

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
        wait_until(lambda: self.driver.assembler.remaining_ns(0) is None, "the last cycle to close", 5.0)

    @property
    def frames(self) -> list[int]:
        return self.driver.counts.frames


@pytest.fixture
def bench(simulated_can: dict[str, Any]) -> Iterator[Bench]:
    one = Bench(simulated_can)
    yield one
    assert one.driver.stop()
    one.sender.shutdown()


def test_invalid_datagrams_are_counted(bench: Bench) -> None:
    rng = np.random.default_rng(2)
    datagrams = [rng.bytes(int(rng.integers(1, 60))) for _ in range(50)]
    datagrams += [msgpack.packb({"dlc": 99, "data": b"", "arbitration_id": -1}), msgpack.packb([1]), b"\x80"]
    bench.send(cycle(HAND, 0))
    for datagram in datagrams:
        bench.sender._multicast.send(datagram)  # type: ignore[attr-defined]
    bench.send(cycle(HAND, 1))
    wait_until(lambda: len(bench.cycles) == 2, "both cycles", 5.0)
    assert bench.driver.status.unreadable + bench.frames[FrameKind.UNKNOWN_ID] == len(datagrams)
    assert (bench.driver.status.state, bench.driver.status.reconnects) == (OPEN, 0)


def test_random_frames_are_counted_exactly_and_disturb_only_for_a_while(bench: Bench) -> None:
    rng = np.random.default_rng(1)
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
        bench.send(frames)
    wait_until(lambda: sum(bench.frames) == bench.sent, "all frames", 10.0)
    found = dict(zip(FrameKind, bench.frames, strict=True))
    looks_good = FrameKind.DATA, FrameKind.DUPLICATE, FrameKind.OUT_OF_ORDER
    assert {kind: found[kind] for kind in FrameKind if kind not in looks_good} == {
        kind: expected[kind] for kind in FrameKind if kind not in looks_good
    }
    assert sum(found[kind] for kind in looks_good) == expected[FrameKind.DATA] > 1000
    for n in range(100):
        bench.send(cycle(HAND, n), pause_s=0.005)
    bench.settle()
    assert [made.sequence.tolist()[0] % 16 for made in bench.cycles[-20:]] == [n % 16 for n in range(80, 100)]
    assert (bench.driver.status.state, bench.driver.status.reconnects) == (OPEN, 0)
