"""CAN sockets of the kernel, on the interface TACTILE_LOCALIZER_CAN (for example vcan0)."""

from __future__ import annotations

import os

import can
import pytest
from support.load_cells import cycle, protocol

from tactile_localizer.io.can.bus import BusSettings, open_bus, receive_queue

CHANNEL = os.environ.get("TACTILE_LOCALIZER_CAN", "")
pytestmark = pytest.mark.skipif(not CHANNEL, reason="TACTILE_LOCALIZER_CAN names no SocketCAN interface")


def test_the_kernel_filters_by_identifier() -> None:
    hand = protocol(["index"])
    sent = [can.Message(arbitration_id=0x7FF, is_extended_id=False), *cycle(protocol(), 0)]
    bus = open_bus(BusSettings("socketcan", CHANNEL, receive_buffer=1 << 20), hand)
    try:
        with can.Bus(interface="socketcan", channel=CHANNEL) as sender:
            for frame in sent:
                sender.send(frame)
            received = [bus.recv(1.0), bus.recv(1.0), bus.recv(0.1)]
        assert [frame and frame.arbitration_id for frame in received] == [0x102, 0x103, None]
        queue = receive_queue(bus)
        assert queue is not None
        assert queue.drops == 0
    finally:
        bus.shutdown()
