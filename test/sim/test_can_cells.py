"""Simulated load cells on a python-can bus within the process."""

from collections import Counter

import can
import numpy as np
import pytest
from support.load_cells import data_of

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
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


@pytest.fixture
def sender(protocol, buses):
    return CanLoadCells(protocol, buses[0], np.random.default_rng(1))


def received(bus):
    messages = []
    while (message := bus.recv(0)) is not None:
        messages.append(message)
    return messages


def test_sent_frames_are_the_voltages_with_a_counter(protocol, buses, sender):
    for number in range(5):
        sender.send(STRAIN)
        frames = received(buses[1])
        assert [protocol.classify(frame)[1:] for frame in frames] == [
            (slot, number) for slot in range(len(protocol.messages))
        ]
        np.testing.assert_allclose(protocol.decode(data_of(protocol, frames))[0], STRAIN, atol=0.2e-3)


def test_frames_are_lost_and_garbage_of_every_kind_is_added(protocol, buses, sender):
    for _ in range(300):
        sender.send(STRAIN, Faults(drop=0.25, garbage=0.5, silent=["index"]))
    found = [protocol.classify(frame)[:2] for frame in received(buses[1])]
    kinds, sent = Counter(kind for kind, _ in found), 300 * len(protocol.messages) / 2
    assert 0.68 < kinds[FrameKind.DATA] / sent < 0.82
    for kind in (FrameKind.UNKNOWN_ID, FrameKind.WRONG_LENGTH, FrameKind.REMOTE, FrameKind.ERROR):
        assert 0.05 < kinds[kind] / sent < 0.2
    assert {protocol.messages[slot].phalanx for kind, slot in found if kind == FrameKind.DATA} == {1}


def test_a_failing_bus_is_reported(buses, sender):
    buses[0].shutdown()
    with pytest.raises(CanError, match="could not send a frame"):
        sender.send(STRAIN)
