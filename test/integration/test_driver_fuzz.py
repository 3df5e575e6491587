"""Random frames on the bus of an installed driver."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.udp_multicast.utils import pack_message
from support.driver import HAND, Listener, Sender

pytestmark = [pytest.mark.ros, pytest.mark.slow]


FRAMES = 200_000

SMALL_BUFFER = 1 << 17
"""Receive buffer that any process may request, bytes (below net.core.rmem_max); the kernel doubles it."""


class Fuzz:
    """Random frames, packed like those of the simulated bus, and their number by kind."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(1)
        self.known = [message.key[0] for message in HAND.messages]
        self.expected = dict.fromkeys(("unknown_id", "wrong_length", "remote", "error", "looks_good"), 0)
        self.unreadable = 0

    def datagrams(self, count: int) -> Iterator[bytes]:
        dice = self.rng.random((count, 2)).tolist()
        lengths = self.rng.choice([8, 0, 3, 7, 12, 64], count, p=[0.5, 0.1, 0.1, 0.1, 0.1, 0.1]).tolist()
        identifiers = self.rng.integers(0x200, 0x7FF, count).tolist()
        noise = self.rng.bytes(64 * count)
        for i in range(count):
            if dice[i][0] < 0.01:
                self.unreadable += 1
                yield b"\xc1" + noise[64 * i : 64 * i + 20]  # 0xC1 is unused in msgpack
                continue
            is_known = dice[i][0] < 0.5
            remote, error = dice[i][1] < 0.1, dice[i][1] > 0.9
            length = 0 if remote else min(lengths[i], 8) if error else lengths[i]
            yield self._pack(is_known, remote, error, length, identifiers[i], noise[64 * i : 64 * i + length])

    def _pack(self, is_known: bool, remote: bool, error: bool, length: int, other: int, data: bytes) -> bytes:
        if error:
            kind, identifier = "error", 0x04  # bus-off would close the bus and discard its queue
        else:
            kind, identifier = "looks_good", self.known[other % 4] if is_known else other
            kind = "remote" if remote else "unknown_id" if not is_known else kind
            kind = "wrong_length" if kind == "looks_good" and length != 8 else kind
        self.expected[kind] += 1
        frame = can.Message(
            arbitration_id=identifier,
            is_extended_id=False,
            is_remote_frame=remote,
            is_error_frame=error,
            is_fd=length > 8,
            data=data,
        )
        return pack_message(frame)


class ReceiveQueue:
    """The receive queue of the kernel for an open UDP port of a process."""

    def __init__(self, pid: int, port: int) -> None:
        opened = set()
        for fd in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(FileNotFoundError):  # closed in the meantime
                opened.add(str(fd.readlink()))
        (self._inode,) = [
            fields[9]
            for fields in self._table()
            if int(fields[1].split(":")[1], 16) == port and f"socket:[{fields[9]}]" in opened
        ]

    @property
    def waiting(self) -> int:
        """Bytes in the queue."""
        return next(int(fields[4].split(":")[1], 16) for fields in self._table() if fields[9] == self._inode)

    @staticmethod
    def _table() -> list[list[str]]:
        return [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]


def test_random_frames_are_counted_exactly(
    driver_process: Callable[..., Any], can_bus: can.BusABC, probe: Any, simulated_can: dict[str, Any]
) -> None:
    node = driver_process(receive_buffer=SMALL_BUFFER)
    listener, fuzz = Listener(probe), Fuzz()
    probe.until(
        lambda: listener.counted("CAN bus")["queue_limit_bytes"] == str(2 * SMALL_BUFFER), "the buffer", 10.0
    )
    queue = ReceiveQueue(node.pid, simulated_can["port"])
    address = simulated_can["channel"], simulated_can["port"]
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)  # not beyond this machine
    for _ in range(FRAMES // 50):
        for datagram in fuzz.datagrams(50):  # at most 2 kB each as the kernel counts
            sender.sendto(datagram, address)
        while queue.waiting > SMALL_BUFFER:  # half full: the driver never runs dry
            time.sleep(0.001)
    sender.close()
    assert sum(fuzz.expected.values()) + fuzz.unreadable == FRAMES

    def counted() -> bool:
        reports = listener.counted("CAN bus")
        found = {kind: int(reports[f"frames_{kind}"]) for kind in fuzz.expected if kind != "looks_good"}
        good = sum(int(reports[f"frames_{kind}"]) for kind in ("data", "duplicate", "out_of_order"))
        return found | {"looks_good": good} == fuzz.expected

    probe.until(counted, "all frames counted", 60.0)
    reports = listener.counted("CAN bus")
    assert (reports["unreadable"], reports["queue_drops"]) == (str(fuzz.unreadable), "0")
    assert (reports["state"], reports["reconnects"]) == ("open", "0")

    hand = Sender(can_bus, probe)
    hand.send(80)  # valid-looking random frames disturb the first cycles
    listener.listen(hand)
    numbers = hand.send(100)
    probe.until(lambda: len(listener.strains) >= 100, "good data")
    assert listener.numbers() == [{n} for n in numbers]
    assert node.running
    assert "Traceback" not in node.output
