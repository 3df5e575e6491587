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


def test_frames_are_dropped_with_the_given_probability(protocol, buses, sender):
    for _ in range(300):
        sender.send(STRAIN, Faults(drop=0.25))
    frames = len(received(buses[1]))
    all_frames = 300 * len(protocol.messages)
    assert 0.68 < frames / all_frames < 0.82


def test_garbage_frames_are_of_every_kind(protocol, buses, sender):
    for _ in range(100):
        sender.send(STRAIN, Faults(garbage=0.5))
    kinds = Counter(protocol.classify(frame)[0] for frame in received(buses[1]))
    assert kinds[FrameKind.DATA] == 100 * len(protocol.messages)
    for kind in (FrameKind.UNKNOWN_ID, FrameKind.WRONG_LENGTH, FrameKind.REMOTE, FrameKind.ERROR):
        assert kinds[kind] > 0


def test_a_silent_cell_sends_nothing(protocol, buses, sender):
    sender.send(STRAIN, Faults(silent=["index"]))
    frames = received(buses[1])
    assert {protocol.messages[protocol.classify(frame)[1]].phalanx for frame in frames} == {1}


def test_a_failing_bus_is_reported(buses, sender):
    buses[0].shutdown()
    with pytest.raises(CanError, match="could not send a frame"):
        sender.send(STRAIN)
