"""Two senders with the same identifiers are distinguished from lost samples."""

from __future__ import annotations

from collections.abc import Iterable

import can
import numpy as np
import pytest
from support.load_cells import PERIOD_NS, START_NS, cycle, protocol, strain_of

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.cycle import Cycle
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.status import MISSING, OK

pytestmark = pytest.mark.slow

HAND = protocol()


def feed(assembler: CycleAssembler, frames: Iterable[can.Message]) -> list[Cycle]:
    return [made for frame in frames for made in assembler.feed([frame])]


OFFSETS = {
    "loadcells.dbc": range(16),
    "loadcells_fd.dbc": [0, 1, 2, 3, 4, 9, 999, 1001, 30_000, 65_000, *range(65_532, 65_536)],
}
"""Offsets between the counters of two senders, by layout."""


@pytest.mark.parametrize(
    ("behind_s", "spacing_s"),
    [(1e-4, 2e-4), (1.5e-4, 1e-4), (2.5e-3, 1e-4)],
    ids=["frames", "cells", "cycles"],
)
@pytest.mark.parametrize("doubled", [(0, 1), (0,), (1,)])
@pytest.mark.parametrize("dbc", OFFSETS)
def test_frames_of_two_senders_are_not_counted_as_lost(
    dbc: str, doubled: tuple[int, ...], behind_s: float, spacing_s: float
) -> None:
    hand = protocol(dbc=dbc)
    for ahead in OFFSETS[dbc]:
        for lead in (0, 32):  # the second sender begins with the first one, or later
            assembler = CycleAssembler(hand, 0.02)
            for frame in frames_of_two_senders(hand, doubled, ahead, lead, behind_s, spacing_s):
                assembler.feed([frame])
            for p, counts in enumerate(assembler.counts.phalanges):
                assert counts.drops <= 2, f"{ahead} ahead, from cycle {lead}"
                assert counts.interleaved > 80 if p in doubled else counts.interleaved < 16


def frames_of_two_senders(
    hand: LoadCellProtocol,
    doubled: tuple[int, ...],
    ahead: int,
    lead: int,
    behind_s: float,
    spacing_s: float,
) -> list[can.Message]:
    """Frames of 120 cycles; after ``lead`` of them a second sender, with another counter, has joined."""
    frames = []
    for n in range(120):
        due_s = (START_NS + n * PERIOD_NS) * 1e-9
        first = cycle(hand, n)
        second = [f for p in doubled for f in hand.encode(p, strain_of(p, n), n + ahead)]
        for i, frame in enumerate(first):
            frame.timestamp = due_s + i * spacing_s
        for i, frame in enumerate(second):
            frame.timestamp = due_s + behind_s + i * spacing_s
        frames += first + second * (n >= lead)
    return sorted(frames, key=lambda frame: frame.timestamp)


@pytest.mark.parametrize("ahead", range(3, 14))
def test_two_senders_that_change_order_are_detected(ahead: int) -> None:
    rng = np.random.default_rng(ahead)
    assembler = CycleAssembler(HAND, 0.02)
    for n in range(200):
        senders = [cycle(HAND, n), [f for p in range(2) for f in HAND.encode(p, strain_of(p, n), n + ahead)]]
        for i, sender in enumerate(rng.permutation(2)):
            for frame in senders[sender]:
                frame.timestamp = (START_NS + n * PERIOD_NS) * 1e-9 + i * 0.002
                feed(assembler, [frame])
    for phalanx in assembler.counts.phalanges:
        assert phalanx.drops <= 2
        assert phalanx.interleaved > 80


def test_strain_of_two_senders_is_not_used() -> None:
    assembler = CycleAssembler(HAND, 0.02)
    made: list[Cycle] = []
    for frame in frames_of_two_senders(HAND, (1,), 6, 32, 2.5e-3, 1e-4):
        made += feed(assembler, [frame])
    assert all(one.status.tolist() == [OK, MISSING] for one in made[40:])
    assert len(made) > 110


def test_a_second_sender_that_ends_leaves_no_trace() -> None:
    assembler = CycleAssembler(HAND, 0.02)
    for frame in frames_of_two_senders(HAND, (0, 1), 6, 0, 2.5e-3, 1e-4):
        feed(assembler, [frame])
    made = feed(assembler, [frame for n in range(120, 200) for frame in cycle(HAND, n)])
    assert all(one.status.tolist() == [OK, OK] for one in made[40:])
    assert len(made) > 70
    assert max(phalanx.drops for phalanx in assembler.counts.phalanges) <= 32
