"""Simulated load cells on a python-can bus within the process."""

from collections import Counter

import can
import numpy as np
import pytest

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, OK
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.can_cells import CanLoadCells, Faults

STRAIN = np.linspace(-1.9, 1.9, 16)


@pytest.fixture(params=["loadcells.dbc", "loadcells_fd.dbc"])
def protocol(request):
    return LoadCellProtocol(resource_path(f"config/{request.param}"), ("index", "middle"))


@pytest.fixture
def buses():
    """A virtual bus's two ends."""
    ends = [can.Bus(interface="virtual", channel="test_can_cells") for _ in range(2)]
    yield ends
    for end in ends:
        end.shutdown()


def cells(protocol, bus):
    return CanLoadCells(protocol, bus, np.random.default_rng(1))


def received(bus):
    messages = []
    while (message := bus.recv(0)) is not None:
        messages.append(message)
    return messages


def classified(protocol, bus):
    return [protocol.classify(frame) for frame in received(bus)]


def test_sent_frames_are_the_voltages_with_a_counter(protocol, buses):
    sender = cells(protocol, buses[0])
    for number in range(5):
        sender.send(STRAIN)
        messages = received(buses[1])
        data = bytearray(protocol.size)
        for kind, slot, counter in map(protocol.classify, messages):
            assert (kind, counter) == (FrameKind.DATA, number)
            data[protocol.bytes_of(slot)] = messages[slot].data  # in the order of the messages
        np.testing.assert_allclose(protocol.decode(data)[0], STRAIN, atol=0.2e-3)


def test_frames_are_dropped_with_the_given_probability(protocol, buses):
    sender = cells(protocol, buses[0])
    for _ in range(300):
        sender.send(STRAIN, Faults(drop=0.25))
    frames = len(received(buses[1]))
    all_frames = 300 * len(protocol.messages)
    assert 0.68 < frames / all_frames < 0.82


def test_garbage_frames_are_of_every_kind(protocol, buses):
    sender = cells(protocol, buses[0])
    for _ in range(100):
        sender.send(STRAIN, Faults(garbage=0.5))
    kinds = Counter(kind for kind, _, _ in classified(protocol, buses[1]))
    assert kinds[FrameKind.DATA] == 100 * len(protocol.messages)
    for kind in (FrameKind.UNKNOWN_ID, FrameKind.WRONG_LENGTH, FrameKind.REMOTE, FrameKind.ERROR):
        assert kinds[kind] > 0


def test_silent_and_faulty_cells(protocol, buses):
    sender = cells(protocol, buses[0])
    sender.send(STRAIN, Faults(silent=["index"], faulty=["middle"]))
    frames = received(buses[1])
    slots = [protocol.classify(frame)[1] for frame in frames]
    assert {protocol.messages[slot].phalanx for slot in slots} == {1}
    data = bytearray(protocol.size)
    for slot, frame in zip(slots, frames, strict=True):
        data[protocol.bytes_of(slot)] = frame.data
    assert protocol.decode(data)[1].tolist() == [OK, FAULT]


def test_a_failing_bus_is_reported(protocol, buses):
    sender = cells(protocol, buses[0])
    buses[0].shutdown()
    with pytest.raises(CanError, match="could not send a frame"):
        sender.send(STRAIN)
