"""No strain vector holds samples of different cycles, whatever happens to the bus and to the receive times.

``TACTILE_LOCALIZER_CASES=10000`` runs as many cases; the default is 400.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from support.load_cells import START_NS, number_of, protocol, strain_of

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.cycle import Cycle
from tactile_localizer.io.can.frames import FrameBatch
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.status import MISSING, OK

CASES = int(os.environ.get("TACTILE_LOCALIZER_CASES", "400"))
BLOCK = 100
MS = 1_000_000
QUIET = 80
"""Cycles at the end of each case in which nothing goes wrong."""

CLASSIC, FD = "loadcells.dbc", "loadcells_fd.dbc"


@cache
def hand_of(dbc: str, phalanges: int) -> tuple[LoadCellProtocol, np.ndarray]:
    """A hand, and the data of its frames: (phalanx, number, frame, byte), with counters of 0."""
    hand = protocol(("index", "middle", "ring")[:phalanges], dbc)
    frames = [
        [[list(f.data) for f in hand.encode(p, strain_of(p, n), 0)] for n in range(500)]
        for p in range(phalanges)
    ]
    return hand, np.array(frames, dtype=np.uint8)


@dataclass
class Bus:
    """What happens to the frames of one case, drawn from ``rng``."""

    rng: np.random.Generator

    def __post_init__(self) -> None:
        rng = self.rng
        self.dbc = str(rng.choice([CLASSIC, CLASSIC, FD]))
        self.phalanges = int(rng.choice([2, 2, 2, 3]))
        self.hand, self.data = hand_of(self.dbc, self.phalanges)
        self.parts = self.data.shape[2]
        self.span = 16 if self.dbc == CLASSIC else 65536
        self.cycles = QUIET + int(rng.integers(100, 220))
        self.period_ns = int(rng.choice([1, 5, 10]) * MS)
        self.spacing_ns = min(0.13 * MS, self.period_ns / (2 * self.phalanges * self.parts))
        self.wait_s = float(rng.choice([0.004, 0.03, 0.2]))
        self.loss = float(rng.choice([0, 0, 0.02, 0.1, 0.3]))
        self.doubled = float(rng.choice([0, 0, 0.02]))
        self.jitter_ns = float(rng.choice([0, 0.2, 1.0]) * MS)
        self.any_order = bool(rng.random() < 0.35)
        # Frames that are held up delay all that follow, or arrive together with them when they are let go:
        # then no more of the time than half, or the frames would pile up for ever.
        self.delays_all = bool(rng.random() < 0.5)
        self.held_up = float(rng.choice([0, 0.003, 0.02, 0.1]))
        if not self.delays_all:
            self.held_up = min(self.held_up, self.period_ns / (300 * MS * self.phalanges * self.parts))
        self._counters_and_silences()

    def _counters_and_silences(self) -> None:
        rng = self.rng
        first = rng.integers(0, self.span, self.phalanges if rng.random() < 0.5 else 1)[:, None]
        self.counter = np.tile(np.arange(self.cycles), (self.phalanges, 1)) + first
        self.silent = np.zeros((self.phalanges, self.cycles), dtype=bool)
        begin = 20
        while rng.random() < 0.7:
            begin += int(rng.integers(0, 40))
            p, end = int(rng.integers(self.phalanges)), begin + int(rng.choice([2, 3, 9, 15, 16, 17, 40, 60]))
            if end > self.cycles - QUIET:
                return
            self.silent[p, begin:end] = True
            if rng.random() < 0.6:  # it restarts, with a counter that nearly fits if it is one of 4 bits
                value = int(self.counter[p, end] + rng.integers(-2, 3)) if self.span == 16 else 0
                value = value if rng.random() < 0.6 else int(rng.integers(self.span))
                self.counter[p, end:] = value + np.arange(self.cycles - end)
            begin = end + 2

    def frames(self) -> FrameBatch:
        """All frames, in the order of their arrival."""
        rng = self.rng
        keys = self.hand.layout.key.reshape(self.phalanges, self.parts)
        order = rng.permutation(self.phalanges)
        key, stamps, data, counters = [], [], [], []
        self._now = self._delay = 0.0
        for n in range(self.cycles):
            quiet = n >= self.cycles - QUIET
            if n == self.cycles - QUIET:
                self._delay = max(self._delay, self._now - n * self.period_ns)
            phalanges = rng.permutation(self.phalanges) if self.any_order else order
            sent = [(p, part) for p in phalanges if not self.silent[p, n] for part in range(self.parts)]
            for place, (p, part) in enumerate(sent):
                for stamp in self._received(n * self.period_ns + place * self.spacing_ns, quiet):
                    key.append(keys[p, part])
                    stamps.append(START_NS + int(stamp))
                    data.append(self.data[p, n, part])
                    counters.append(self.counter[p, n] % self.span)
        bytes_, count = np.array(data), np.array(counters)
        if self.dbc == CLASSIC:
            bytes_[:, 7] |= count.astype(np.uint8)
        else:
            bytes_[:, 16], bytes_[:, 17] = count >> 8, count & 255
        return FrameBatch(
            np.array(key, np.uint32), np.array(stamps), np.full(len(key), self.hand.width), bytes_
        )

    def _received(self, due: float, quiet: bool) -> list[float]:
        """Receive times, ns, of a frame that is due at ``due``; none where it is lost."""
        rng = self.rng
        due += self._delay
        copies = 1
        if not quiet:
            due += abs(rng.normal(0, self.jitter_ns))
            if rng.random() < self.held_up:
                held = rng.uniform(0, 300 * MS)
                if self.delays_all:
                    self._delay += held
                else:
                    self._now = max(self._now, due) + held
            if rng.random() < self.loss:
                return []
            copies += rng.random() < self.doubled
        self._now = max(self._now + 10_000, due)
        return [self._now] * copies

    def assemble(self) -> list[Cycle]:
        frames, assembler = self.frames(), CycleAssembler(self.hand, self.wait_s)
        size = int(self.rng.integers(1, 40))
        made: list[Cycle] = []
        for i in range(0, len(frames), size):
            rows = slice(i, i + size)
            batch = FrameBatch(
                frames.key[rows], frames.stamp_ns[rows], frames.length[rows], frames.data[rows]
            )
            made += assembler.feed(batch)
        return made


def numbers_in(cycle: Cycle) -> set[int]:
    """Samples that the phalanges that are not missing are of; fails where one is put together of two."""
    return {
        number_of(p, cycle.strain[8 * p : 8 * p + 8])
        for p, status in enumerate(cycle.status)
        if not status & MISSING
    }


@pytest.mark.parametrize("first", range(0, CASES, BLOCK))
def test_no_vector_mixes_cycles(first: int) -> None:
    not_back = 0
    for seed in range(first, min(first + BLOCK, CASES)):
        bus = Bus(np.random.default_rng(seed))
        made = bus.assemble()
        assert all(len(numbers_in(cycle)) <= 1 for cycle in made), f"seed {seed}"
        not_back += set(made[-1].status) != {OK}
    assert not_back <= 0.03 * BLOCK  # most load cells are aligned again after the quiet end


@pytest.mark.parametrize("dbc", [CLASSIC, FD])
def test_the_random_traffic_is_realistic(dbc: str) -> None:
    hand, data = hand_of(dbc, 2)
    count = 9 if dbc == CLASSIC else 0x1234
    sent = [list(frame.data) for frame in hand.encode(1, strain_of(1, 7), count)]
    for frame in data[1, 7]:
        if dbc == CLASSIC:
            frame[7] |= count
        else:
            frame[16], frame[17] = count >> 8, count & 255
    assert data[1, 7].tolist() == sent
