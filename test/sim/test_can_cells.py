"""Simulated load cells on a python-can bus within the process."""

from collections import Counter

import can
import numpy as np
import pytest

from tactile_localizer.errors import CanError, ParameterError
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.can_cells import CanLoadCells, Faults

STRAIN = np.linspace(-1.9, 1.9, 16)


@pytest.fixture(params=["loadcells.dbc", "loadcells_fd.dbc"])
def protocol(request):
    return LoadCellProtocol.from_dbc(resource_path(f"config/{request.param}"), ("index", "middle"))


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


def test_sent_frames_decode_to_the_same_voltages(protocol, buses):
    sender = cells(protocol, buses[0])
    sender.send(STRAIN)
    messages = received(buses[1])
    decoded = sorted(map(protocol.decode, messages), key=lambda one: one.slot)
    assert {one.kind for one in decoded} == {FrameKind.DATA}
    assert len(messages) == len(protocol.message_names)
    voltages = np.concatenate([one.voltage for one in decoded])
    np.testing.assert_allclose(np.sort(voltages), STRAIN, atol=0.2e-3)


def test_the_counter_increments_per_sample(protocol, buses):
    sender = cells(protocol, buses[0])
    for _ in range(5):
        sender.send(STRAIN)
    decoded = [protocol.decode(frame) for frame in received(buses[1])]
    assert [one.counter for one in decoded if one.slot == 0] == [0, 1, 2, 3, 4]


def test_frames_are_dropped_with_the_given_probability(protocol, buses):
    sender = cells(protocol, buses[0])
    for _ in range(300):
        sender.send(STRAIN, Faults(drop=0.25))
    frames = len(received(buses[1]))
    all_frames = 300 * len(protocol.message_names)
    assert 0.68 < frames / all_frames < 0.82


def test_garbage_frames_are_of_every_kind(protocol, buses):
    sender = cells(protocol, buses[0])
    for _ in range(100):
        sender.send(STRAIN, Faults(garbage=0.5))
    decoded = [protocol.decode(frame) for frame in received(buses[1])]
    kinds = Counter(one.kind for one in decoded)
    assert kinds[FrameKind.DATA] == 100 * len(protocol.message_names)
    for kind in (FrameKind.UNKNOWN_ID, FrameKind.WRONG_LENGTH, FrameKind.REMOTE, FrameKind.ERROR):
        assert kinds[kind] > 0
    assert len({one.voltage[0] for one in decoded if one.slot == 0}) == 1


def test_silent_and_faulty_cells(protocol, buses):
    sender = cells(protocol, buses[0])
    sender.send(STRAIN, Faults(silent=["index"], faulty=["middle"]))
    decoded = [protocol.decode(frame) for frame in received(buses[1])]
    names = [protocol.message_names[one.slot] for one in decoded]
    assert names
    assert all(name.startswith("middle") for name in names)
    assert all(one.fault for one in decoded)


def test_a_failing_bus_is_reported(protocol, buses):
    sender = cells(protocol, buses[0])
    buses[0].shutdown()
    with pytest.raises(CanError, match="could not send a frame"):
        sender.send(STRAIN)


def test_probabilities_above_one_are_refused():
    with pytest.raises(ParameterError, match=r"drop: expected a probability of 0 to 1, got 1\.5"):
        Faults(drop=1.5)
